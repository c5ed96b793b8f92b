"""Result of one check, and the protection of checks against errors."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum


class Status(StrEnum):
    """Result of a check: correct, worth knowing, or to be repaired."""

    OK = "ok"
    WARN = "warn"
    FAIL = "FAIL"


@dataclass(frozen=True)
class Check:
    """Name, result and finding of one check; the finding is one sentence."""

    name: str
    status: Status
    text: str


MakeCheck = Callable[[], Check]


def guarded(name: str, make_check: MakeCheck) -> Check:
    """Return the result of `make_check`; an error that it raises becomes a failed check.

    On a broken machine any check can raise any error, and the other checks must still run.
    """
    try:
        return make_check()
    except Exception as error:
        sentence = " ".join(str(error).split())
        return Check(name, Status.FAIL, f"{type(error).__name__}: {sentence}")
