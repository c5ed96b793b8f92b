"""Errors that a user can fix: each says what, where, and what would be right."""

import difflib
import errno
import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# Bytes that are not UTF-8, which file names may contain; characters that move a terminal's cursor
# or end a line; characters that change the direction of writing.
UNPRINTABLE = re.compile("[\ud800-\udfff\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def printable(text: str) -> str:
    """Return `text` with unprintable characters encoded as in a URL, such as %1B for escape."""
    return UNPRINTABLE.sub(_in_percent, text)


def counted(count: int, noun: str) -> str:
    """Return a count with its `noun`, which takes an s in the plural: 1 frame, 2 frames."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def error_sentence(error: Exception) -> str:
    """Return the sentence of a `SymgraspError`, or of the system's error about a file."""
    if isinstance(error, OSError) and not error.filename and error.errno in NO_SPACE:
        return f"a file cannot be written ({error.strerror})"
    if isinstance(error, OSError) and error.filename and error.strerror:
        name = os.fsdecode(error.filename) if not isinstance(error.filename, int) else "a file"
        return printable(f"{name} cannot be read or written ({error.strerror})")
    return printable(str(error))


def _in_percent(found: re.Match[str]) -> str:
    place = ord(found[0])
    if 0xD800 <= place <= 0xDFFF:
        return f"%{place & 0xFF:02X}"
    return "".join(f"%{byte:02X}" for byte in found[0].encode())


class SymgraspError(Exception):
    """Base of every error that is reported as one sentence instead of a traceback.

    `exit_code`: exit code of the command that it ends: 1 for bad data, 2 for wrong usage.
    """

    exit_code: int = 1
    arguments: tuple[object, ...] | None = None  # those of a constructor that takes no sentence

    def __str__(self) -> str:
        """Return the sentence, in one line."""
        return printable(Exception.__str__(self))  # KeyError would put it in quotes

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Return the pickled form, in which a worker passes the error to its parent."""
        return super().__reduce__() if self.arguments is None else (type(self), self.arguments)


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """End the program with exit code 1 and one sentence on stderr, if a user can fix the error.

    For scripts of the project; `symgrasp` itself has its own boundary.
    """
    try:
        yield
    except (SymgraspError, OSError) as error:
        sys.stderr.write(f"error: {error_sentence(error)}\n")
        raise SystemExit(1) from error


class FormatError(SymgraspError):
    """The content of a file does not match its format."""

    def __init__(self, path: Path | str, found: str, expected: str) -> None:
        super().__init__(f"{path}: {found}; {expected}")
        self.arguments = (path, found, expected)


class WriteError(SymgraspError):
    """A result cannot be written, which is no fault of its item; other results would fail too."""

    def __init__(self, path: Path | str, why: str) -> None:
        super().__init__(
            f"{path} cannot be written ({why}); once it can, the same command continues, "
            "a training with --resume"
        )
        self.why, self.arguments = why, (path, why)


class MissingInputError(SymgraspError):
    """An input of a stage does not exist yet."""

    def __init__(self, path: Path | str, written_by: str) -> None:
        super().__init__(f"{path} does not exist; `{written_by}` writes it")
        self.arguments = (path, written_by)


class UnknownNameError(SymgraspError):
    """A given name is not among the known names."""

    exit_code: int = 2

    def __init__(
        self, kind: str, name: str, known: Iterable[str], nearest: str | None = None
    ) -> None:
        known = sorted(known)
        nearest = nearest or next(iter(difflib.get_close_matches(str(name), known, 1)), None)
        hint = "" if nearest is None else f", the nearest is {nearest!r}"
        super().__init__(f"{kind} {name!r} is not known{hint}; known are {', '.join(known)}")
        self.arguments = (kind, name, known, nearest)


class StaleOutputError(SymgraspError):
    """An output exists that was made with other settings or from other inputs.

    `missing`: names of inputs that do not exist any more, without which it cannot be made again.
    """

    def __init__(self, path: Path | str, missing: Iterable[str] = ()) -> None:
        names = ", ".join(missing)
        super().__init__(
            f"{path} was made from inputs that do not exist any more ({names}); restore them"
            if names
            else f"{path} was made with other settings or inputs; "
            "pass --overwrite to make it again, or choose another output"
        )
        self.arguments = (path, [*missing])


class ValueRangeError(SymgraspError):
    """A value is out of range; the value of an option, such as `--top`, is wrong usage."""

    def __init__(self, name: str, found: object, expected: str) -> None:
        super().__init__(f"{name} is {found}; it must be {expected}")
        self.exit_code = 2 if name.startswith("--") else 1
        self.arguments = (name, found, expected)


class SettingError(ValueRangeError):
    """A setting in a file or on the command line has an invalid value: wrong usage."""

    def __init__(self, name: str, found: object, expected: str) -> None:
        super().__init__(name, found, expected)
        self.exit_code = 2
