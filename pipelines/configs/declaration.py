"""Declaration of a setting: default, unit, meaning, origin and range.

    approach: float = setting(0.10, "m", "Distance along the approach axis.", "D. 48")
    min_affordance: float = fraction(0.5, "Least affordance of a contact.", "Sec. III-E")
    rank_by: Ranking = choice("critic", "Order of grasps.", "D. 82")

The option of a command, the settings file, `--set` and the reference all read this declaration.
"""

from dataclasses import dataclass, field
from math import inf, pi
from typing import TypeVar

Default = TypeVar("Default")

# Origin of a number without a paper, record or data sheet.
BY_EYE = "chosen by eye"
DECLARATION = "declaration"
# Largest value of each unit; the smallest is 0 unless the setting has another.
UNITS = {
    "": inf,  # no number
    "share": 1.0,
    "count": inf,
    "factor": inf,
    "weight": inf,
    "diameters": 1.0,  # of the object
    "m": inf,
    "m2": inf,
    "1/m": inf,
    "Lab": inf,  # CIE 1976
    "px": inf,
    "px2/px": inf,
    "rad": pi,
    "deg": 180.0,
    "s": inf,
    "N": inf,
    "object weights": inf,
    "m/s2": inf,
    "bytes": inf,
    "direction": inf,  # a vector whose length does not matter
}


@dataclass(frozen=True)
class Declaration:
    """Unit, meaning, origin and range of a setting; its dataclass has the name and the type.

    Attributes:
        unit: one of `UNITS`; empty for names and switches.
        meaning: a sentence for users.
        origin: a section of the paper, a decision record (`D. 82`), a sensor, or `BY_EYE`.
        low: smallest accepted number.
        high: largest accepted number.
        fewest: least length of a list of any length.
    """

    unit: str
    meaning: str
    origin: str
    low: float
    high: float
    fewest: int = 1


def setting(
    default: Default,
    unit: str,
    meaning: str,
    origin: str,
    *,
    low: float = 0.0,
    high: float | None = None,
    fewest: int = 1,
) -> Default:
    """Declare a number, or a tuple of numbers, as a field of a config."""
    largest = UNITS[unit] if high is None else high
    declared = Declaration(unit, meaning, origin, low, largest, fewest)
    return field(default=default, metadata={DECLARATION: declared})


def count(
    default: Default, meaning: str, origin: str, *, low: float = 1, high: float | None = None
) -> Default:
    """Declare a count, or a tuple of counts."""
    return setting(default, "count", meaning, origin, low=low, high=high)


def fraction(default: Default, meaning: str, origin: str) -> Default:
    """Declare a share, 0 to 1."""
    return setting(default, "share", meaning, origin)


def choice(default: Default, meaning: str, origin: str) -> Default:
    """Declare a switch, a name, or one of the names that a `Literal` lists."""
    return setting(default, "", meaning, origin)
