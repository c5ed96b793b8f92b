"""Start of the command line, which handles signals before it imports anything heavy."""

import gc
import os
import sys
from pathlib import Path

from pipelines.ending import end_on_signals


def main() -> None:
    """Run the command line."""
    end_on_signals()
    open_closed_streams()
    from symgrasp_cli.app import app

    try:
        app()
    finally:
        if "pipelines.runtime.clusters" in sys.modules:  # else no command can have started workers
            sys.modules["pipelines.runtime.clusters"].end_workers()
        gc.freeze()  # the interpreter would look through all of torch for cycles before it ends


def open_closed_streams() -> None:
    """Open the null device in place of standard streams that the calling program has closed.

    Otherwise workers cannot start, and a file of ours would get the number of a stream.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # Takes the lowest free number, and stays open.
            stream = Path(os.devnull).open(mode, encoding="utf-8")  # noqa: SIM115
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)
