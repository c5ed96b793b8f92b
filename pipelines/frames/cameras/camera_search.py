"""Search for camera files next to images: by their names, else by their content."""

import re
from collections import Counter
from collections.abc import Container, Iterator
from functools import lru_cache
from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.frames.cameras.camera_files import (
    CameraFile,
    SeveralCamerasError,
    may_hold_camera,
    read_camera_file,
)
from pipelines.frames.pairing.image_names import names_view
from pipelines.storage.array_files import read_npy
from pipelines.storage.files import read_text

# Names that are searched next to the images, in this order; after them any *.intr.
SHARED_CAMERA_FILES = (
    *("camera.json", "camera_params.json", "camera_intrinsics.json", "camera_intrinsic.json"),
    *("camera_data.json", "intrinsics.json", "intrinsic.json", "cam_info.json", "camera_info.json"),
    *("camera_info.yaml", "meta.yml", "cam_K.txt", "camera-intrinsics.txt"),
    *("test-camera-intrinsics.txt", "camera_intrinsics.txt", "intrinsics.txt"),
    *("intrinsic/intrinsic_depth.txt", "camK.npy", "meta.mat", "transforms.json"),
    "scene_camera.json",
)
# Endings of a frame's own camera file, which is searched first.
OWN_CAMERA_ENDINGS = ("camera.json", "intrinsics.json", "meta.mat")
# Isaac Sim's, other programs' and Polycam's, which are searched next.
OTHER_OWN_FILES = ("camera_params_{}.json", "camera_{}.json", "cameras/{}.json")
# Suffixes of other files that may hold a camera, and of files that are only named to the user.
READ = (".json", ".yaml", ".yml", ".intr", ".txt", ".csv", ".xml", ".npy", ".toml", ".ini")
NAMED = (*READ, ".cfg", ".conf", ".mat")
TEXTS = (".txt", ".csv", ".json", ".yaml", ".yml")
CAMERA_WORDS = re.compile("cam|intrin|calib|lens|^K", re.IGNORECASE)
# Four bare numbers, also as a list of JSON or of YAML.
FOUR_NUMBERS = re.compile(
    r"(?:\[\s*|-\s+)?(?:[\d.eE+-]+[\s,;]+(?:-\s+)?){3}[\d.eE+-]+(?:\s*\])?",
)
MOST_FILES = 20  # of one suffix in a folder; more files are poses or labels, one per frame
MOST_BYTES = 100_000
MOST_NAMED = 3  # files in a sentence
MILLIMETRES = 1000.0  # per metre, unless a file states another unit
SHORTEST, LEAST_CENTER = 10.0, 1.0  # pixels; the numbers of a pose are smaller


def find_camera_file(folder: Path, name: str) -> Path | None:
    """Return the camera file of frame `name` in `folder`: its own, or the folder's."""
    return own_camera_file(folder, name) or shared_camera_file(folder)


def own_camera_file(folder: Path, name: str, listed: Container[str] | None = None) -> Path | None:
    """Return the camera file of frame `name` alone.

    `listed`: all names in `folder`, if known; then only existing files are looked at.
    """

    def is_there(file: str) -> bool:
        return (listed is None or file.partition("/")[0] in listed) and (folder / file).is_file()

    own = [f"{name}{mark}{end}" for end in OWN_CAMERA_ENDINGS for mark in "_-."]
    own += [each.format(name) for each in OTHER_OWN_FILES]
    found = next(filter(is_there, own), None)
    if found is not None:
        return folder / found
    plain, in_meta = f"{name}.json", f"meta/{name}.mat"  # GraspNet's meta/
    # A NAME.json may hold labels, with a picture as text, instead of a camera.
    is_small = is_there(plain) and (folder / plain).stat().st_size <= MOST_BYTES
    if is_small and may_hold_camera(folder / plain):
        return folder / plain
    return folder / in_meta if is_there(in_meta) else None


def shared_camera_file(folder: Path, view: str = "") -> Path | None:
    """Return the camera file of all frames in `folder` whose images have the `view` of a camera.

    A file with an unusual name counts if no file next to it holds another camera, or if it alone is
    named after the `view`, `color` or `depth`.
    """
    shared = (folder / file for file in SHARED_CAMERA_FILES)
    usual = next((path for path in shared if path.is_file()), None)
    usual = usual or min(folder.glob("*.intr"), default=None)
    if usual is not None:
        return usual
    found = list(cameras_in(folder, view))
    units = {round(camera.units_per_metre or MILLIMETRES) for _path, camera in found}
    if view and len(units) == 1:  # else the unit of the depth may be in the other camera's file
        found = [each for each in found if names_view(each[0].stem, view)] or found
    lenses = {(camera.fx, camera.fy, camera.cx, camera.cy) for _path, camera in found}
    return found[0][0] if len(lenses) == 1 else None


def cameras_in(folder: Path, view: str = "") -> Iterator[tuple[Path, CameraFile]]:
    """Yield the files of `folder` that hold a camera, whatever their names."""
    for path in _small_files(folder, READ):
        try:
            camera = read_camera_file(path, view=view)
        except (SymgraspError, OSError):
            continue
        center = min(camera.cx, camera.cy)
        is_large = min(camera.fx, camera.fy) >= SHORTEST and center >= LEAST_CENTER
        if is_large and not _may_be_a_box(path):
            yield path, camera


def _may_be_a_box(path: Path) -> bool:
    """Return whether a file holds four bare numbers, such as a box, under no name of a camera."""
    if CAMERA_WORDS.search(path.stem):
        return False
    if path.suffix.lower() == ".npy":
        return read_npy(path).ndim == 1
    if path.suffix.lower() not in TEXTS:
        return False
    return FOUR_NUMBERS.fullmatch(read_text(path).strip()) is not None


def where_a_camera_may_be(image: Path) -> str:
    """Return advice for the user on an image without a known camera."""
    # The folder of the images, that of rgb/ and depth/, and that of all scenes.
    return _advice(*((folder, _last_change(folder)) for folder in image.parents[:3]))


@lru_cache(maxsize=64)  # all frames of a folder may lack a camera, and each would search all files
def _advice(*folders: tuple[Path, int]) -> str:
    advice = "give --intrinsics fx,fy,cx,cy"
    found = [path for folder, _changed in folders for path, _camera in cameras_in(folder)]
    if len(found) == 1:
        return f"{advice}, or --intrinsics {found[0]}, which holds a camera"
    if found:
        names = " and ".join(map(str, found[:MOST_NAMED]))
        which = "that of the depth image, or of the colour it is registered to"
        return f"{advice}, or as --intrinsics one of {names}: {which}"
    near = [path for folder, _changed in folders[:2] for path in _small_files(folder, NAMED)]
    if several := next(filter(None, map(_several_cameras, near)), ""):
        return f"{advice}; {several}"
    others = [path.name for path in near]
    unread = f"; no camera was found in {', '.join(others[:MOST_NAMED])}" if others else ""
    known = "*_camera.json, intrinsics.json, cam_K.txt, ..."
    return f"{advice}, or put a camera file ({known}) next to it{unread}"


def _several_cameras(path: Path) -> str:
    """Return the sentence on a file that holds several cameras; "" for another file."""
    try:
        read_camera_file(path)
    except SeveralCamerasError as error:
        return str(error)
    except (SymgraspError, OSError):
        pass
    return ""


def _last_change(folder: Path) -> int:
    """Return when a file was last added to `folder`, in nanoseconds; 0 if there is no folder."""
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return 0


def _small_files(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """List the small files with one of `suffixes`; none of a suffix that files of frames have."""
    try:
        named = [path for path in folder.iterdir() if path.suffix.lower() in suffixes]
        counts = Counter(path.suffix.lower() for path in named)
        few = sorted(path for path in named if counts[path.suffix.lower()] <= MOST_FILES)
        seen = (path for path in few if path.is_file() and not path.name.startswith("."))
        return [path for path in seen if path.stat().st_size <= MOST_BYTES]
    except OSError:
        return []
