"""Mark of a folder that a command is still making: later commands refuse a folder that bears one.

The mark goes when all is made. A run that was killed, or that failed in part, leaves it behind; one
that was refused and wrote nothing leaves a finished folder as it was.
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
    """Take the mark of `command` off `folder`."""
    (folder / MARK.format(command=command)).unlink(missing_ok=True)


def refuse_unfinished(folder: Path) -> None:
    """Raise a SymgraspError if `folder` was not made to its end."""
    head, tail = MARK.split("{command}")
    mark = min(folder.glob(MARK.format(command="*")), default=None)
    if mark is not None:
        command = mark.name.removeprefix(head).removesuffix(tail)
        raise SymgraspError(
            f"{folder} is unfinished: `symgrasp {command}` still writes it, was stopped, or failed "
            f"in part; run the same command again, or delete {mark} to use what is there"
        )
