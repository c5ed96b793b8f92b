"""Pinhole cameras from small files of many forms that are next to images.

Internally the unit of depth is always `units_per_metre`; `stated_units` reads it.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.configs.toml_files import read_toml
from pipelines.errors import FormatError, SymgraspError, ValueRangeError
from pipelines.frames.cameras.lens import NO_DISTORTION, Distortion, distortion_in
from pipelines.frames.cameras.stated_cameras import (
    OAK_KEY,
    SKEW_KEYS,
    SYNONYMS,
    cameras_below,
    is_bare_camera,
    stated_matrix,
    states_a_camera,
    with_camera,
)
from pipelines.frames.cameras.stated_sizes import first_stated, stated_size
from pipelines.frames.depth.stated_units import check_units, units_in
from pipelines.frames.encodings.camera_texts import (
    MATRIX_SIZES,
    read_camera_ini,
    read_camera_text,
    read_camera_xml,
    read_pincam,
)
from pipelines.frames.encodings.yaml_files import read_yaml
from pipelines.frames.graspnet_scene import read_meta
from pipelines.geometry.camera import Intrinsics
from pipelines.storage.array_files import read_npy
from pipelines.storage.files import is_file, read_json
from pipelines.storage.provenance import FileVersion

TEXTS = (".txt", ".csv", ".xml", ".ini")
POLYCAM_KEY = "t_00"  # of the pose in a file of Polycam, whose depth is smaller than the colour
SIXD_INDEX = "info.yml"  # a camera for each image
FORMS = "fx, fy, cx, cy or a 3x3 matrix (cam_K, K, intrinsic_matrix) is expected"
# A principal point this near the border means intrinsics of another image size.
CENTRAL = (0.1, 0.9)
# Least focal length, in sides of the image. Below it, the camera would see more than 175 degrees,
# which no pinhole camera does: the number is in other units, such as the lens's millimetres.
SHORTEST_LENGTH = 0.02
MOST_SKEW = 1.0  # pixels; it moves a pixel by half as much at most


class SeveralCamerasError(FormatError):
    """A file with several cameras, of which no name tells the right one."""


@dataclass(frozen=True)
class CameraFile:
    """A camera as a file or an option states it; sizes and unit may be unknown."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int | None = None
    height: int | None = None
    units_per_metre: float | None = None
    origin: str = "--intrinsics"
    distortion: Distortion = NO_DISTORTION
    is_of_any_size: bool = False  # resized to images of any size, which all show one view

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy"):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= 0:
                raise ValueRangeError(f"{self.origin}: {name}", value, "positive, in pixels")
        check_units(f"depth scale of {self.origin}", self.units_per_metre)

    def at(self, width: int, height: int) -> Intrinsics:
        """Return the intrinsics for images of this size.

        Raises:
            FormatError: the camera is for another image size, or its lengths are not in pixels.
        """
        size = f"{width}x{height}"
        if self.width is not None and (self.width, self.height) != (width, height):
            resized = self._resized(width, height)
            if resized is not None and self.is_of_any_size:
                return CameraFile.of(resized, self.origin).at(width, height)
            found = f"describes {self.width}x{self.height} images, but the depth is {size}"
            expected = "give the intrinsics of the depth image"
            if i := resized:
                numbers = f"{i.fx:.6g},{i.fy:.6g},{i.cx:.6g},{i.cy:.6g}"
                expected += f", --intrinsics {numbers} if it is registered to those images"
            raise FormatError(self.origin, found, expected)
        if self.fx < SHORTEST_LENGTH * width or self.fy < SHORTEST_LENGTH * height:
            found = f"has focal lengths of {self.fx:g} and {self.fy:g} pixels for a {size} image"
            raise FormatError(self.origin, found, "give fx and fy in pixels, not in millimetres")
        low, high = CENTRAL
        if not (low < self.cx / width < high and low < self.cy / height < high):
            found = f"has its principal point at ({self.cx:g}, {self.cy:g}) of a {size} depth image"
            scaled = "multiply those of a larger image by the ratio of the sizes"
            raise FormatError(self.origin, found, f"give those of the depth image; {scaled}")
        return Intrinsics(self.fx, self.fy, self.cx, self.cy, width, height)

    def _resized(self, width: int, height: int) -> Intrinsics | None:
        """Return the intrinsics for the same image at another size; None if its ratio differs."""
        if self.width is None or self.height is None or self.width * height != self.height * width:
            return None
        own = Intrinsics(self.fx, self.fy, self.cx, self.cy, self.width, self.height)
        return own.resized(width, height)

    @classmethod
    def of(cls, intrinsics: Intrinsics, origin: str = "--intrinsics") -> "CameraFile":
        """Return the camera of known `intrinsics`."""
        i = intrinsics
        return cls(i.fx, i.fy, i.cx, i.cy, i.width, i.height, origin=origin)

    @classmethod
    def from_matrix(cls, path: Path, matrix: NDArray[Any], **facts: Any) -> "CameraFile":  # noqa: ANN401
        """Return the camera of a (3, 3), (3, 4) or (4, 4) `matrix` from the file `path`."""
        try:
            K = np.asarray(matrix, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise FormatError(path, f"holds a value that is no number ({error})", FORMS) from error
        if K.shape == (3, 4) and K[:, 3].any():
            found = "a camera matrix with numbers in its fourth column, as of a second camera"
            raise FormatError(path, found, "give that of the first camera")
        if K.shape not in ((3, 3), (3, 4), (4, 4)):
            raise FormatError(path, f"a camera matrix of shape {K.shape}", "3x3 is expected")
        if not abs(K[2, 2] - 1.0) <= 1e-6:  # written so that nan fails too
            found = f"a camera matrix with {K[2, 2]:g} in its third row and column"
            raise FormatError(path, found, "1 is expected; cameras without calibration have 0")
        _refuse_skew(path, float(K[0, 1]))
        if not (below := np.abs(K[[1, 2, 2], [0, 0, 1]])).max() <= MOST_SKEW:
            found = f"a camera matrix with {below.max():g} below its diagonal"
            raise FormatError(path, found, "0 is expected")
        fx, fy, cx, cy = (float(K[row, column]) for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return cls(fx, fy, cx, cy, origin=str(path), **facts)


def parse_camera(text: str) -> CameraFile:
    """Return the camera of `--intrinsics`: four numbers fx,fy,cx,cy, or a file's path."""
    try:
        numbers = [float(part) for part in re.split(r"[,\s]+", text.strip())]
    except ValueError:
        if Path(text).suffix or is_file(Path(text)):
            return read_camera_file(Path(text))
        numbers = []
    if len(numbers) != 4:
        raise ValueRangeError("--intrinsics", text, "fx,fy,cx,cy in pixels, or a camera file")
    fx, fy, cx, cy = numbers
    return CameraFile(fx, fy, cx, cy)


def read_camera_file(path: Path, frame: str = "", view: str = "") -> CameraFile:
    """Read a camera file of any known form: json, intr, yaml, txt, csv, xml, npy, mat.

    A BOP `scene_camera.json` has one camera a frame; `frame` names it. `view`: see `with_camera`.

    Raises:
        FormatError: the file has none of the known forms.
    """
    return camera_from_mapping(path, _content(path, frame), view)


def read_units(path: Path, frame: str = "", view: str = "") -> float | None:
    """Return the unit in a camera file, None if it states none; it need not hold a camera."""
    suffix = path.suffix.lower()
    try:
        content = _content(path, frame)
    except FormatError:
        if suffix not in TEXTS:  # a text may hold several cameras: the user states one of them
            raise
        return None
    return units_of(path, with_camera(content, view)) if isinstance(content, dict) else None


def units_of(path: Path, content: Mapping[str, Any]) -> float | None:
    """Return the unit that the keys of the file `path` state, None if they state none."""
    try:
        units = units_in(content)
    except (TypeError, ValueError, OverflowError) as error:
        expected = "units per metre, or the name of a unit, are expected"
        raise FormatError(path, f"holds a value that is no number ({error})", expected) from error
    check_units(f"depth scale of {path}", units)
    return units


def _content(path: Path, frame: str) -> Any:  # noqa: ANN401 - JSON
    """Return the content of a file with keys, or the part of it that is on this frame."""
    suffix = path.suffix.lower()
    if path.name == SIXD_INDEX and is_file(path):
        scene = _scene_cameras(FileVersion.of(path))
        is_scene = isinstance(scene, dict) and not states_a_camera(with_camera(scene))
        return _camera_of(path, scene, frame) if is_scene else scene
    if suffix in READERS:
        return READERS[suffix](path)
    if suffix not in (".json", ".intr"):
        raise SymgraspError(f"{path} is no camera file; give .json, .yaml, .txt, .npy or .mat")
    if not path.name.startswith("scene_camera"):
        return read_json(path)
    content = _scene_cameras(FileVersion.of(path))
    return _camera_of(path, content, frame) if isinstance(content, dict) else content


def _read_mat(path: Path) -> dict[str, Any]:
    meta = read_meta(path)
    return {"K": meta.intrinsic_matrix.tolist(), "factor_depth": meta.factor_depth}


READERS: dict[str, Callable[[Path], Any]] = {
    **dict.fromkeys((".yml", ".yaml"), read_yaml),
    **dict.fromkeys((".txt", ".csv"), read_camera_text),
    ".xml": read_camera_xml,
    ".ini": read_camera_ini,
    ".toml": lambda path: read_toml(path, FORMS),
    ".pincam": read_pincam,
    ".mat": _read_mat,
    ".npy": lambda path: read_npy(path).tolist(),
}


@lru_cache(maxsize=4)  # one file holds the cameras of all images of a scene
def _scene_cameras(file: FileVersion) -> Any:  # noqa: ANN401 - JSON or YAML
    return read_json(file.path) if file.path.suffix == ".json" else read_yaml(file.path)


def camera_from_mapping(path: Path, content: Any, view: str = "") -> CameraFile:  # noqa: ANN401
    """Return the camera of the keys and values of the file `path`; `view`: see `with_camera`.

    Raises:
        FormatError: keys are missing, or values are no numbers.
    """
    if is_bare_camera(content):
        content = {"intrinsics": content}
    if not isinstance(content, dict):
        raise FormatError(path, "this has no keys", FORMS)
    content = with_camera(content, view)
    try:
        facts: dict[str, Any] = stated_size(content)
        facts["units_per_metre"] = units_of(path, content)
        facts["distortion"] = distortion_in(path, content)
        facts["is_of_any_size"] = POLYCAM_KEY in content or OAK_KEY in content
        matrix = stated_matrix(content)
        values = {name: first_stated(content, keys) for name, keys in SYNONYMS.items()}
        if isinstance(matrix, list) and np.size(matrix) == len(values):  # Kalibr's
            values = dict(zip(values, matrix, strict=True))
        elif matrix is not None:
            return CameraFile.from_matrix(path, _matrix(path, matrix), **facts)
        missing = [name for name, value in values.items() if value is None]
        if missing and len(several := cameras_below(content)) > 1:
            found = f"holds the cameras {', '.join(several)}"
            raise SeveralCamerasError(path, found, "give that of the depth image as --intrinsics")
        if missing:
            raise FormatError(path, f"lacks {', '.join(missing)}", FORMS)
        fx, fy, cx, cy = (float(value) for value in values.values())
        _refuse_skew(path, float(first_stated(content, SKEW_KEYS) or 0.0))
    except (TypeError, ValueError, OverflowError) as error:
        raise FormatError(path, f"holds a value that is no number ({error})", FORMS) from error
    return CameraFile(fx, fy, cx, cy, origin=str(path), **facts)


def may_hold_camera(path: Path) -> bool:
    """Return whether a JSON file holds a camera, or is too damaged to tell; labels hold none."""
    try:
        content = read_json(path)
    except (SymgraspError, OSError):
        return True
    return isinstance(content, dict) and states_a_camera(with_camera(content))


def _camera_of(path: Path, scene: dict[str, Any], frame: str) -> Any:  # noqa: ANN401 - JSON
    """Return the camera of one image of a BOP scene; the keys have no leading zeros."""
    if not frame:
        raise FormatError(path, "has a camera for each image", "name one camera's file instead")
    if (key := frame.lstrip("0") or "0") not in scene:
        raise FormatError(path, f"lacks a camera for image {key}", "each image of rgb/ has one")
    return scene[key]


def _refuse_skew(path: Path, skew: float) -> None:
    if not abs(skew) <= MOST_SKEW:  # written so that nan fails too
        expected = "rectify the images, or write 0 if they are rectified"
        raise FormatError(path, f"describes a camera with a skew of {skew:g} pixels", expected)


def _matrix(path: Path, stored: list[Any] | dict[str, Any]) -> Array:
    values = stored["data"] if isinstance(stored, dict) else stored
    numbers = np.asarray(values, dtype=np.float64).ravel()
    if numbers.size not in MATRIX_SIZES:
        raise FormatError(path, f"a camera matrix of {numbers.size} numbers", "9 are expected")
    K = numbers.reshape(4 if numbers.size == 16 else 3, -1)
    # Open3D stores column after column: then the principal point is in the last row.
    return np.asarray(K.T if K[2, 0] > 1.0 and K[0, 2] == 0.0 else K)
