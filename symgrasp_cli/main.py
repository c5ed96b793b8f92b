"""Start of the command line, which handles signals before it imports anything heavy."""

import gc
import sys

from pipelines.ending import end_on_signals


def main() -> None:
    """Run the command line."""
    end_on_signals()
    from symgrasp_cli.app import app

    try:
        app()
    finally:
        if "pipelines.runtime.clusters" in sys.modules:  # else no command can have started workers
            sys.modules["pipelines.runtime.clusters"].end_workers()
        gc.freeze()  # the interpreter would look through all of torch for cycles before it ends
