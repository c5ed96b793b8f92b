"""Mark in a folder that a command is still writing: later commands refuse a marked folder.

The mark is removed when all is written. A run that was killed, or that failed in part, leaves the
mark; a run that was refused and wrote nothing leaves a finished folder unchanged.
"""

from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.storage.files import write_text

MARK = "UNFINISHED-{command}.txt"


def mark_unfinished(folder: Path, command: str) -> bool:
    """Mark `folder` as being made by `symgrasp COMMAND`; return whether it was finished before."""
    mark = folder / MARK.format(command=command)
    was_finished = folder.is_dir() and any(folder.iterdir()) and not mark.exists()
    text = f"`symgrasp {command}` writes this folder, or was stopped; run it again to finish it.\n"
    write_text(mark, text)
    return was_finished


def mark_finished(folder: Path, command: str) -> None:
    """Remove the mark of `command` from `folder`."""
    (folder / MARK.format(command=command)).unlink(missing_ok=True)


def refuse_unfinished(folder: Path) -> None:
    """Raise a SymgraspError if `folder` is unfinished."""
    head, tail = MARK.split("{command}")
    mark = min(folder.glob(MARK.format(command="*")), default=None)
    if mark is not None:
        command = mark.name.removeprefix(head).removesuffix(tail)
        raise SymgraspError(
            f"{folder} is unfinished: `symgrasp {command}` still writes it, was stopped, or failed "
            f"in part; run the same command again, or delete {mark} to use it unfinished"
        )
