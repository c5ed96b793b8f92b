"""Names of colour and depth images: the word that marks each, and the rest, which both share."""

import re
from functools import lru_cache
from pathlib import Path

COLOR_WORDS = ("color", "colour", "rgb")
WORD = "|".join((*COLOR_WORDS, "depth"))
ALONE = re.compile(rf"({WORD})(?:_image)?|image_({WORD})", re.IGNORECASE)
ENDING = re.compile(rf"(.+)[-_.]({WORD})", re.IGNORECASE)
BEGINNING = re.compile(rf"({WORD})(?:[-_.]|(?=\d+(?:[-_.]|$)))(.+)", re.IGNORECASE)  # also color0
# Depth registered to the colour, as tools of RealSense, Azure Kinect and ROS name it.
TO_COLOR = r"[-_.]?to[-_.]?(?:colou?r|rgb)"
ALIGNED_DEPTH = re.compile(
    rf"(?<![a-z])(?:aligned|registered|transformed)[-_.]?depth(?:{TO_COLOR})?"
    rf"|depth(?:[-_.]?(?:aligned|registered|transformed)(?:{TO_COLOR})?|{TO_COLOR})(?![a-z])",
    re.IGNORECASE,
)


def without_word(stem: str, words: tuple[str, ...]) -> str | None:
    """Return `stem` without the word that ends or begins it, None if that is none of `words`.

    The last word decides: rgb_1_depth is the depth of rgb_1, and no colour image.
    """
    word, rest = word_and_rest(stem)
    return rest if word in words else None


@lru_cache(maxsize=1 << 16)  # `infer --watch` lists the same folder again and again
def word_and_rest(stem: str) -> tuple[str, str]:
    """Return the word that ends or begins `stem`, in lower case, and the rest; "" for no word."""
    stem = ALIGNED_DEPTH.sub("depth", stem)
    if alone := ALONE.fullmatch(stem):
        return next(filter(None, alone.groups())).lower(), ""
    if ending := ENDING.fullmatch(stem):
        return ending[2].lower(), ending[1]
    beginning = BEGINNING.fullmatch(stem)
    return (beginning[1].lower(), beginning[2]) if beginning else ("", "")


def without_inner_word(stem: str, words: tuple[str, ...]) -> str | None:
    """Return `stem` without the word between others; None if the word is at an end or missing."""
    if word_and_rest(stem)[0]:
        return None
    stem = ALIGNED_DEPTH.sub("depth", stem)
    found = re.fullmatch(rf"(.+[-_.])({'|'.join(words)})[-_.](.+)", stem, re.IGNORECASE)
    return None if found is None else f"{found[1]}{found[3]}"


def is_aligned(color: Path, depth: Path) -> bool:
    """Return whether the depth is aligned to the colour, by the name of its file or own folder."""
    folder = depth.parent.name if depth.parent != color.parent else ""
    return any(ALIGNED_DEPTH.search(name) for name in (depth.stem, folder))
