"""Colour and depth images paired by their names, in one folder or in two sister folders."""

import re
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from operator import attrgetter
from pathlib import Path

from pipelines.frames.pairing.image_names import (
    ALIGNED_COLOR,
    ALIGNED_DEPTH,
    WORDS_OF_COLOR,
    of_one_view,
    view_of,
    without_inner_word,
    without_weak_word,
    without_word,
    word_and_rest,
)

COLOR_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm")
DEPTH_SUFFIXES = (".png", ".tif", ".tiff", ".npy", ".npz", ".exr", ".pgm", ".pfm")
COLOR_FOLDERS = ("rgb", "color", "image", "images", "gray", "colors", "rgbs", "left")
DEPTH_FOLDERS = ("depth", "depths", "distance_to_image_plane")
# Rests of the names of arrays that hold facts about the images, such as depth_scale.npy.
FACTS = re.compile("(camera[-_.])?((?i:matrix|params|scale|units?|(in|ex)trinsics?)|K)")
FILLED = re.compile("fill|complet|inpaint", re.IGNORECASE)  # depth that is partly guessed
# 1-gt, the rest of depth1-gt.png, and vis_1, that of depth_vis_1.png.
FURTHER = (re.compile(r"(.+?)(?:[-_.][a-zA-Z]+)+"), re.compile(r"[a-zA-Z]+[-_.](.+)"))
ImageFiles = dict[str, list[Path]]  # by the rest of the name; the first file is taken


@dataclass(frozen=True)
class ImagePair:
    """The colour and depth files of one frame; one of them may be missing."""

    stem: str  # rest of the file name, "" if the name was only `color` or `rgb`
    color: Path | None
    depth: Path | None
    rivals: tuple[Path, ...] = ()  # several files that could be its colour, or its depth

    @property
    def is_whole(self) -> bool:
        """Whether both files are there."""
        return self.color is not None and self.depth is not None

    @property
    def view(self) -> str:
        """The camera whose view both images have; see `view_of`."""
        return view_of(self.color, self.depth) if self.color and self.depth else ""


def flat_pairs(folder: Path) -> list[ImagePair]:
    """Pair files by name: `x_color`, `x-rgb`, `color_x`, `color`, `image` with their depth."""
    files = sorted((path for path in folder.iterdir() if path.is_file()), key=attrgetter("name"))
    colors = _by_stem(files, COLOR_SUFFIXES, WORDS_OF_COLOR)
    depths = _by_stem(files, DEPTH_SUFFIXES, ("depth",))
    # x-rgb-img.jpg and x-depth-img.exr; each without the other may be anything.
    between = (
        _by_stem(files, COLOR_SUFFIXES, WORDS_OF_COLOR, within=True),
        _by_stem(files, DEPTH_SUFFIXES, ("depth",), within=True),
    )
    for stem in between[0].keys() & between[1].keys():
        colors.setdefault(stem, between[0][stem])
        depths.setdefault(stem, between[1][stem])
    depths = {
        stem: paths for stem, paths in depths.items() if stem in colors or not _is_fact(stem, paths)
    }
    # x_depth_color.png is a picture of the depth, unless it is the colour of x_depth_depth.png.
    colors = {
        stem: paths
        for stem, paths in colors.items()
        if stem in depths or without_word(stem, ("depth",)) is None
    }
    others = _others_by_stem(files)
    colors |= {stem: others[stem] for stem in depths if stem not in colors and stem in others}
    whole = colors.keys() & depths.keys()
    pairs = _paired(colors, depths)
    return [pair for pair in pairs if pair.is_whole or not _is_further(pair, whole)]


def _is_further(lone: ImagePair, whole: Container[str]) -> bool:
    """Return whether a lone image is a further picture of a whole frame, as depth1-gt of depth1."""
    image = lone.color or lone.depth
    if image is None or not image.stem.endswith(lone.stem):
        return False
    further = (pattern.fullmatch(lone.stem) for pattern in FURTHER)
    return any(found is not None and found[1] in whole for found in further)


def _others_by_stem(files: Sequence[Path]) -> ImageFiles:
    """Map names without a weak word, else whole names, to the images without a word of their own.

    Such an image is the colour of a depth image for which there is no better one.
    """
    images = [path for path in files if not word_and_rest(path.stem)[0]]
    whole = _by_stem(images, COLOR_SUFFIXES)
    weak: ImageFiles = {}
    for stem, paths in whole.items():
        if (rest := without_weak_word(stem)) != stem:
            weak.setdefault(rest, []).extend(paths)
    return whole | weak


def _is_fact(stem: str, depths: Sequence[Path]) -> bool:
    """Return whether files are arrays of other numbers, such as depth_intrinsics.npy."""
    are_arrays = all(path.suffix.lower() in (".npy", ".npz") for path in depths)
    return are_arrays and FACTS.fullmatch(stem) is not None


def _paired(colors: ImageFiles, depths: ImageFiles) -> list[ImagePair]:
    pairs = []
    for stem in sorted(colors.keys() | depths.keys()):
        color, depth = of_one_view(colors.get(stem, []), depths.get(stem, []))
        rivals = (*_rivals(color), *_rivals(depth))
        pairs.append(ImagePair(stem, next(iter(color), None), next(iter(depth), None), rivals))
    return pairs


def _rivals(candidates: Sequence[Path]) -> list[Path]:
    """Return the candidates with the suffix of the first, if several: none of them is preferred.

    Of x_depth.png and x_depth.npy the first is preferred; x_color.png and x-color.png may be two
    frames.
    """
    suffixes = [path.suffix.lower() for path in candidates]
    alike = [path for path, each in zip(candidates, suffixes, strict=True) if each == suffixes[0]]
    return alike if len(alike) > 1 else []


def _by_stem(
    files: Iterable[Path],
    suffixes: tuple[str, ...],
    words: tuple[str, ...] | None = None,
    *,
    within: bool = False,
) -> ImageFiles:
    """Map the rest of a file's name, without its word, to the files, best suffix first.

    With `words` None the whole name counts. `within`: the word is between other words instead of
    at an end.
    """
    without = without_inner_word if within else without_word
    found: ImageFiles = {}
    ordered = [path for path in files if path.suffix.lower() in suffixes]
    ordered.sort(key=lambda path: (suffixes.index(path.suffix.lower()), path.name))
    for path in ordered:
        stem = path.stem if words is None else without(path.stem, words)
        if stem is not None:
            found.setdefault(stem, []).append(path)
    return found


def sister_pairs(folder: Path, suffix: str = "") -> list[ImagePair]:
    """Pair `rgb/x` with `depth/x`; several names of both folders are in use.

    Depth in a folder such as `aligned_depth_to_color` is preferred to `depth`, which may be raw;
    else colour in a folder such as `transformed_color` to raw colour.
    `suffix`: suffix of the names of both folders.
    """
    aligned_depth, aligned_color = (
        None if suffix else _folder_like(folder, pattern)
        for pattern in (ALIGNED_DEPTH, ALIGNED_COLOR)
    )
    color_folder = sister(folder, COLOR_FOLDERS, suffix)
    if aligned_color is not None and (aligned_depth is None or color_folder is None):
        color_folder = aligned_color
    depth_folder = aligned_depth or sister(folder, DEPTH_FOLDERS, suffix)
    is_by_word = not suffix and (color_folder is None or depth_folder is None)
    if is_by_word:
        color_folder, depth_folder = _by_word(folder, color_folder, depth_folder)
    if color_folder is None or depth_folder is None:
        return []
    if is_by_word and any(pair.is_whole for pair in flat_pairs(color_folder)):
        return []  # it holds the frames, and a folder such as depth_previews/ pictures of them
    return pairs_in(color_folder, depth_folder)


def _by_word(folder: Path, color: Path | None, depth: Path | None) -> Sequence[Path | None]:
    """Return the only two folders that differ by a word, as `rgb_raw` and `depth_raw`.

    Else `color` and `depth`, each replaced, if None, by the only folder with its word, as
    `depth_images`.
    """
    folders = sorted(path for path in folder.iterdir() if path.is_dir())
    colors, depths = (_without_any_word(folders, words) for words in (WORDS_OF_COLOR, ("depth",)))
    alike = [(*colors[rest], *depths[rest]) for rest in colors.keys() & depths.keys()]
    if len(alike) == 1 and len(alike[0]) == 2:
        return alike[0]
    named = [list(chain(*found.values())) for found in (colors, depths)]
    named[1] = [path for path in named[1] if not FILLED.search(path.name)] or named[1]
    only = (found[0] if len(found) == 1 else None for found in named)
    return [known or other for known, other in zip((color, depth), only, strict=True)]


def pairs_in(color_folder: Path, depth_folder: Path) -> list[ImagePair]:
    """Pair the images of two folders: x and x, else color_x and depth_x, else frame_x and x."""
    files = [
        _by_stem(color_folder.iterdir(), COLOR_SUFFIXES),
        _by_stem(depth_folder.iterdir(), DEPTH_SUFFIXES),
    ]
    kinds = (WORDS_OF_COLOR, ("depth",))
    plain = [
        _renamed(found, partial(without_word, words=words))
        for found, words in zip(files, kinds, strict=True)
    ]
    weak = [_renamed(found, without_weak_word) for found in plain]
    pairs = (each for each in (files, plain, weak) if each[0].keys() & each[1].keys())
    return _paired(*next(pairs, files))


def _without_any_word(folders: Iterable[Path], words: tuple[str, ...]) -> ImageFiles:
    """Map the rest of the names, without one of `words` at an end or between others, to folders."""
    found: ImageFiles = {}
    for path in folders:
        rest = without_word(path.name, words)
        rest = without_inner_word(path.name, words) if rest is None else rest
        if rest is not None:
            found.setdefault(rest, []).append(path)
    return found


def _renamed(files: ImageFiles, rest_of: Callable[[str], str | None]) -> ImageFiles:
    """Map the rests of the names by `rest_of`, or whole names where it is None, to the files."""
    found: ImageFiles = {}
    for stem, paths in files.items():
        rest = rest_of(stem)
        found.setdefault(stem if rest is None else rest, []).extend(paths)
    return found


def _folder_like(folder: Path, pattern: re.Pattern[str]) -> Path | None:
    """Return the first folder in `folder` whose whole name has the `pattern`."""
    named = (path for path in sorted(folder.iterdir()) if pattern.fullmatch(path.name))
    return next((path for path in named if path.is_dir()), None)


def sister(folder: Path, names: Iterable[str], suffix: str = "") -> Path | None:
    """Return the first folder in `folder` with one of `names`, in the usual letter cases."""
    cased = (each for name in names for each in (name, name.capitalize(), name.upper()))
    found = (folder / f"{name}{suffix}" for name in cased)
    return next((path for path in found if path.is_dir()), None)
