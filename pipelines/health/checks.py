"""One thing that was looked at, and what was found."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum


class Status(StrEnum):
    """How a thing is: as it should be, worth knowing, or to be mended."""

    OK = "ok"
    WARN = "warn"
    FAIL = "FAIL"


@dataclass(frozen=True)
class Check:
    """What was found of one thing, in one sentence."""

    name: str
    status: Status
    text: str


Look = Callable[[], Check]


def looked_at(name: str, look: Look) -> Check:
    """Return what `look` finds; whatever it raises is what is wrong with the thing.

    A machine on which something is broken can raise anything anywhere, and the other things are to
    be looked at all the same.
    """
    try:
        return look()
    except Exception as error:
        sentence = " ".join(str(error).split())
        return Check(name, Status.FAIL, f"{type(error).__name__}: {sentence}")
