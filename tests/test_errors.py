"""Sentences of errors: one line, without characters that move a terminal's cursor."""

import errno
import logging
import pickle

import pytest

from pipelines.errors import FormatError, SymgraspError, counted, error_sentence, printable
from symgrasp_cli.app import PlainFormatter


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain \u00fc \u4e2d", "plain \u00fc \u4e2d"),
        ("\x1b[31mred", "%1B[31mred"),
        ("a\nerror: b\r", "a%0Aerror: b%0D"),
        ("\udce9t\udce9", "%E9t%E9"),
        ("\x9b2J", "%C2%9B2J"),
        ("\u202egnp.exe", "%E2%80%AEgnp.exe"),
    ],
)
def test_control_characters_are_written_as_in_a_url(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert str(SymgraspError(text)) == shown


def test_an_error_of_the_system_names_the_file_and_the_reason() -> None:
    error = PermissionError(13, "Permission denied", "a\x1b/b.json")
    assert error_sentence(error) == "a%1B/b.json cannot be read or written (Permission denied)"
    assert error_sentence(OSError("no file")) == "no file"
    full = OSError(errno.ENOSPC, "No space left on device")  # as Python's streams raise it
    assert error_sentence(full) == "a file cannot be written (No space left on device)"
    assert error_sentence(FormatError("a", "b", "c")) == "a: b; c"


def test_an_error_that_a_worker_sends_back_has_the_same_text() -> None:
    error = FormatError("a\x1b", "b", "c")
    assert str(pickle.loads(pickle.dumps(error))) == str(error) == "a%1B: b; c"


def test_a_warning_about_a_strange_name_is_one_line() -> None:
    record = logging.LogRecord("x", logging.WARNING, "", 0, "%s: odd", ("a\n\x1b[2J",), None)
    assert PlainFormatter("%(message)s").format(record) == "a%0A%1B[2J: odd"


@pytest.mark.parametrize(("count", "text"), [(0, "0 frames"), (1, "1 frame"), (12, "12 frames")])
def test_only_a_count_of_one_takes_the_singular(count: int, text: str) -> None:
    assert counted(count, "frame") == text
