"""Files that are not read: of a folder without RGB-D frames, and in the place of an image."""

import os
import re
from collections import Counter
from itertools import islice
from pathlib import Path

from pipelines.frames.pairing.image_names import WORDS_OF_COLOR, word_and_rest
from pipelines.frames.pairing.image_pairs import (
    COLOR_FOLDERS,
    COLOR_SUFFIXES,
    DEPTH_FOLDERS,
    DEPTH_SUFFIXES,
    sister,
)
from pipelines.storage.files import is_file

NOT_READ = (".bin", ".csv", ".gif", ".hdr", ".heic", ".jp2", ".mat", ".pkl", ".raw", ".txt")
IMAGE_SUFFIXES = (*DEPTH_SUFFIXES, *COLOR_SUFFIXES, *NOT_READ)
MOST_FILES = 5000
MOST_KINDS = 6
SAVE_ARRAYS = "save each frame as PNG files, or as .npz with depth, K and image (RGB)"
HINTS = {
    ".r3d": "export colour and depth images from Record3D",
    ".depth": "export colour and depth images (EXR) from Record3D",
    ".svo": "save the left images and the depth of a ZED recording as PNG",
    ".svo2": "save the left images and the depth of a ZED recording as PNG",
    ".mkv": "take the images of an Azure Kinect recording out with Open3D",
    ".zdf": "save the organised cloud as .pcd and give --depth-units-per-metre 1000",
    ".oni": "take the images of an OpenNI recording out",
    ".active": "run `rosbag reindex` on a recording that was not ended, and name it .bag",
    ".klg": "take the images of the recording out",
    ".raw": "save raw depth as a 16-bit PNG next to the colour image",
    ".h5": SAVE_ARRAYS,
    ".hdf5": SAVE_ARRAYS,
    ".npz": "the arrays of an .npz are named depth, K, and rgb (BGR) or image (RGB)",
    ".ply": "a cloud is read as an organised .pcd only",
    **dict.fromkeys((".zip", ".tar", ".gz", ".tgz", ".7z", ".bz2", ".zst", ".zstd"), "unpack it"),
    **dict.fromkeys(
        (".mp4", ".avi", ".mov"),
        "save a video's images, as by `ffmpeg -i rgb.mp4 -start_number 0 rgb/%06d.png`",
    ),
}
WANTED = (
    "put x_color.png next to x_depth.png and x_camera.json, or rgb/ next to depth/; "
    "the documentation's page File formats lists all layouts"
)


def why_no_frames(folder: Path) -> str:
    """Return the sentence on a folder in which no layout finds a frame."""
    walk = (Path(top, name) for top, _below, names in os.walk(folder) for name in names)
    files = list(islice((path for path in walk if not path.name.startswith(".")), MOST_FILES))
    kinds = Counter(path.suffix.lower() or "without a suffix" for path in files)
    if not kinds:
        return f"{folder} holds no RGB-D frames; it holds no files, or hidden ones only; {WANTED}"
    common = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(MOST_KINDS))
    hints = list(
        dict.fromkeys(HINTS[kind] for kind, _count in kinds.most_common() if kind in HINTS)
    )
    parts = [f"its files are {common}", _missing(folder, files), *hints, WANTED]
    return f"{folder} holds no RGB-D frames; {'; '.join(filter(None, parts))}"


def why_no_frame(file: Path) -> str:
    """Return the sentence on a path that is no folder, and no file of a frame."""
    if not is_file(file):
        found = "is no file or folder" if file.exists() else "does not exist"
        return f"{file} {found}; give the folder that holds the frames"
    advice = HINTS.get(file.suffix.lower(), WANTED)
    return f"{file} is part of no RGB-D frame; {advice}"


def _missing(folder: Path, files: list[Path]) -> str:
    images = [path for path in files if path.suffix.lower() in COLOR_SUFFIXES]
    depths = [path for path in files if "depth" in path.relative_to(folder).as_posix().lower()]
    if not images and not depths:
        return "no images are among them"
    if not depths:
        return "no name has the word depth"
    others = sorted(set(images) - set(depths))
    if not others:
        return f"no colour image goes with {depths[0].relative_to(folder)}"
    first, other = (path.relative_to(folder) for path in (depths[0], others[0]))
    return f"{first} and {other} are no pair by their names"


def unread_partner(image: Path, missing: str) -> tuple[str, str] | None:
    """Return the fault of a file in the place of the `missing` image, `depth` or `colour`.

    The second text says what would be right; it is empty if the file's name is at fault. None if
    there is no such file.
    """
    words, folders, read, kinds = (
        (("depth",), DEPTH_FOLDERS, DEPTH_SUFFIXES, "a 16-bit PNG, TIFF or PGM, .npy, .exr or .pfm")
        if missing == "depth"
        else (WORDS_OF_COLOR, COLOR_FOLDERS, COLOR_SUFFIXES, "PNG, JPEG, BMP, TIFF, WebP or PPM")
    )
    word = word_and_rest(image.stem)[0]
    at = image.stem.lower().rfind(word)
    head, tail = image.stem[:at], image.stem[at + len(word) :]
    places = [image.parent / f"{head}{each}{tail}" for each in words if word]
    if (beside := sister(image.parent.parent, folders)) is not None and not word:
        places.append(beside / image.stem)
    named = (Path(f"{place}{suffix}") for place in places for suffix in IMAGE_SUFFIXES)
    other = next((path for path in named if os.path.lexists(path)), None)
    if other is None and word:
        other = _with_further_words(image, words, read)
    if other is None:
        return None
    if not is_file(other):
        return f"{other.name}, which is no file", "put the image in place of this link or folder"
    if other.suffix in read:
        return f"{other.name}, whose name does not pair with it", ""
    return f"{other.name}, which is not read", f"save {missing} as {kinds}"


def _with_further_words(
    image: Path, words: tuple[str, ...], suffixes: tuple[str, ...]
) -> Path | None:
    """Return a file with one of `words` and all words of the frame's name, as x_depth_raw.png."""
    wanted = _words_of(word_and_rest(image.stem)[1])
    fit = [
        path
        for path in islice(image.parent.iterdir(), MOST_FILES)
        if path.suffix in suffixes
        and wanted <= (has := _words_of(path.stem))
        and not has.isdisjoint(words)
    ]
    return min(fit, key=lambda path: (len(path.name), path.name), default=None)


def _words_of(stem: str) -> set[str]:
    return set(re.split("[-_.]", stem.lower())) - {""}
