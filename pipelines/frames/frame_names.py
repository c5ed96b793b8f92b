"""Last parts of the names of frames, by which users may name files of their own."""

from collections import Counter
from collections.abc import Iterable


def last_part(name: str) -> str:
    """Return the last part of a frame's name, the name of its files in their folder."""
    return name.rsplit("/", 1)[-1]


def shared_last_parts(names: Iterable[str]) -> set[str]:
    """Return the last parts that several of the frames with `names` share."""
    return {last for last, count in Counter(map(last_part, names)).items() if count > 1}
