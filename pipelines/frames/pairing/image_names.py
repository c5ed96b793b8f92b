"""Names of colour and depth images: the word that marks each, and the rest, which both share."""

import re
from functools import lru_cache
from pathlib import Path

WORDS_OF_COLOR = ("color", "colour", "rgb")
WORD = "|".join((*WORDS_OF_COLOR, "depth"))
ALONE = re.compile(rf"({WORD})(?:_image)?|image_({WORD})", re.IGNORECASE)
ENDING = re.compile(rf"(.+)[-_.]({WORD})", re.IGNORECASE)
BEGINNING = re.compile(rf"({WORD})(?:[-_.]|(?=\d+(?:[-_.]|$)))(.+)", re.IGNORECASE)  # also color0
COLOR, DEPTH = "(?:colou?r|rgb)", "depth"


def _aligned(image: str, other: str) -> re.Pattern[str]:
    """Return the pattern of an image that is registered to the view of the other camera.

    Tools of RealSense, Azure Kinect and ROS name it so.
    """
    words, to = "(?:aligned|registered|transformed)", rf"[-_.]?to[-_.]?{other}"
    return re.compile(
        rf"(?<![a-z]){words}[-_.]?{image}(?:{to})?"
        rf"|{image}(?:[-_.]?{words}(?:{to})?|{to})(?![a-z])",
        re.IGNORECASE,
    )


# Other names of depth along the optical axis; Isaac Sim's distance_to_camera is along the ray.
OTHER_DEPTH = re.compile(r"depth[-_.]?map(?![a-z])|distance_to_image_plane", re.IGNORECASE)
WEAK_WORD = "(?:image|img|frame|left)"  # ROS's frame0000, a ZED's left000000
WEAK = re.compile(
    rf"{WEAK_WORD}(?:[-_.]|(?=\d))(.+)|(.+)[-_.]{WEAK_WORD}|{WEAK_WORD}", re.IGNORECASE
)
ALIGNED_DEPTH, ALIGNED_COLOR = _aligned(DEPTH, COLOR), _aligned(COLOR, DEPTH)


def without_word(stem: str, words: tuple[str, ...]) -> str | None:
    """Return `stem` without the word that ends or begins it, None if that is none of `words`.

    The last word decides: rgb_1_depth is the depth of rgb_1, and no colour image.
    """
    word, rest = word_and_rest(stem)
    return rest if word in words else None


@lru_cache(maxsize=1 << 16)  # `infer --watch` lists the same folder again and again
def word_and_rest(stem: str) -> tuple[str, str]:
    """Return the word that ends or begins `stem`, in lower case, and the rest; "" for no word."""
    stem = _plain(stem)
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
    stem = _plain(stem)
    found = re.fullmatch(rf"(.+[-_.])({'|'.join(words)})[-_.](.+)", stem, re.IGNORECASE)
    return None if found is None else f"{found[1]}{found[3]}"


def _plain(stem: str) -> str:
    stem = ALIGNED_COLOR.sub("color", ALIGNED_DEPTH.sub("depth", stem))
    return OTHER_DEPTH.sub("depth", stem)


def without_weak_word(stem: str) -> str:
    """Return `stem` without a word that images of any kind have: the 0 of image_0."""
    found = WEAK.fullmatch(stem)
    return stem if found is None else found[1] or found[2] or ""


def of_one_view(colors: list[Path], depths: list[Path]) -> tuple[list[Path], list[Path]]:
    """Return the images of one camera's view: aligned depth with raw colour, else the reverse.

    Raw depth next to aligned depth has another view than the colour; a depth map next to depth may
    be a picture of it.
    """
    depths = [path for path in depths if not OTHER_DEPTH.search(path.stem)] or depths
    if aligned := [path for path in depths if ALIGNED_DEPTH.search(path.stem)]:
        return [path for path in colors if not ALIGNED_COLOR.search(path.stem)] or colors, aligned
    return [path for path in colors if ALIGNED_COLOR.search(path.stem)] or colors, depths


def view_of(color: Path, depth: Path) -> str:
    """Return the camera whose view both images have, `color` or `depth`; "" if no name tells.

    The names of the files count, and those of their folders if these are two. If both are aligned,
    it may be to a third camera.
    """
    views = []
    for pattern, path, view in ((ALIGNED_DEPTH, depth, "color"), (ALIGNED_COLOR, color, "depth")):
        names = (path.stem, path.parent.name if color.parent != depth.parent else "")
        if any(map(pattern.search, names)):
            views.append(view)
    return views[0] if len(views) == 1 else ""


def names_view(name: str, view: str) -> bool:
    """Return whether `name` contains a word for the camera `view` and none for the other one."""
    named = {
        each: re.search(pattern, name, re.IGNORECASE) is not None
        for each, pattern in (("color", COLOR), ("depth", DEPTH))
    }
    return named.pop(view) and not any(named.values())
