"""Conversion of a caller's arrays to a frame; errors name every common mistake."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Mask
from pipelines.errors import ValueRangeError
from pipelines.frames.cameras.camera_files import CameraFile, camera_from_mapping
from pipelines.frames.depth.stated_units import check_units
from pipelines.frames.rgbd import DepthUnits, Frame, make_frame
from pipelines.geometry.camera import Intrinsics

IntrinsicsLike = Intrinsics | Mapping[str, Any] | ArrayLike
MILLIMETRES_PER_METRE = 1000.0  # units per metre of whole-number depth, as in files
LARGEST_ID = np.iinfo(np.int32).max


@dataclass(frozen=True)
class InstanceMasks:
    """The caller's instance masks.

    Attributes:
        labels: (H, W) int32, one number above 0 for each instance, 0 elsewhere.
        first: the caller's number of label 1: 1 for ids, 0 for indices in a stack.
    """

    labels: NDArray[np.int32]
    first: int = 1


def frame_of(
    color: ArrayLike, depth: ArrayLike, intrinsics: IntrinsicsLike, units: float | None = None
) -> Frame:
    """Return the frame of three arrays; arguments and errors as of `GraspDetector`.

    `units`: divisor that turns the values of `depth` into metres.
    """
    check_units("depth_units_per_metre", units)
    distances, picture = _depth(depth), _color(color)
    if picture.shape[:2] != distances.shape:
        size = f"{picture.shape[1]}x{picture.shape[0]}"
        expected = f"{distances.shape[1]}x{distances.shape[0]} as the depth: register them first"
        raise ValueRangeError("the size of color", size, expected)
    camera = _camera(intrinsics)
    return make_frame(
        (Path("color"), lambda: picture),
        (Path("depth"), distances),
        camera,
        DepthUnits(
            integers=units or camera.units_per_metre or MILLIMETRES_PER_METRE,
            floats=units or 1.0,
            option="depth_units_per_metre",
            is_stated=units is not None,
        ),
    )


def instance_masks(masks: ArrayLike | None, shape: tuple[int, ...]) -> InstanceMasks | None:
    """Return the instances of `masks`; `shape` (H, W) is the depth's."""
    if masks is None:
        return None
    found = _array("masks", masks)
    if found.shape == (0,):  # a list without a mask
        found = np.zeros((0, *shape), bool)
    fits = found.shape[-2:] == shape and found.ndim in (2, 3)
    if fits and found.dtype == bool:
        return _stacked(found.reshape(-1, *shape))
    if not fits or found.ndim != 2 or found.dtype.kind not in "iu":
        height, width = shape
        expected = f"({height}, {width}) whole numbers, 0 = background, or (n, {height}, {width})"
        raise ValueRangeError("masks", _described(found), f"{expected} of bool")
    low, high = (int(found.min()), int(found.max())) if found.size else (0, 0)
    if low < 0 or high > LARGEST_ID:
        raise ValueRangeError("masks", f"between {low} and {high}", f"0 to {LARGEST_ID}")
    return InstanceMasks(found.astype(np.int32))


def workspace_of(
    workspace: ArrayLike | None, shape: tuple[int, ...]
) -> tuple[Mask | None, tuple[float, ...]]:
    """Return the mask (H, W), or the box of six numbers; None and () where there is no limit."""
    if workspace is None:
        return None, ()
    found = _array("workspace", workspace)
    if found.dtype == bool and found.shape == shape:
        return found, ()
    expected = f"a bool mask of the depth's size {shape}, or x0, y0, z0, x1, y1, z1 in metres"
    if found.shape not in ((6,), (2, 3)) or found.dtype.kind not in "fiu":
        raise ValueRangeError("workspace", _described(found), expected)
    box = found.ravel().astype(np.float64)
    if not (np.isfinite(box).all() and (box[:3] < box[3:]).all()):
        raise ValueRangeError("workspace", box.tolist(), "finite, each minimum below its maximum")
    return None, tuple(box.tolist())


def _color(color: ArrayLike) -> NDArray[np.uint8]:
    found = _array("color", color)
    if found.dtype != np.uint8 or found.ndim != 3 or found.shape[2] != 3:
        expected = "(height, width, 3) of uint8: RGB, 0 to 255"
        raise ValueRangeError("color", _described(found), expected)
    return found


def _depth(depth: ArrayLike) -> NDArray[Any]:
    found = _array("depth", np.ma.filled(depth, 0) if np.ma.isMaskedArray(depth) else depth)
    numeric = found.dtype.kind == "f" or (found.dtype.kind in "iu" and found.dtype.itemsize > 1)
    if found.ndim != 2 or not found.size or not numeric:
        expected = "(height, width) of float, metres, or of uint16"
        raise ValueRangeError("depth", _described(found), expected)
    return found


def _camera(intrinsics: IntrinsicsLike) -> CameraFile:
    if isinstance(intrinsics, Intrinsics):
        return CameraFile.of(intrinsics, "intrinsics")
    if isinstance(intrinsics, Mapping):
        return camera_from_mapping(Path("intrinsics"), _as_json(intrinsics))
    found = _array("intrinsics", intrinsics)
    if found.shape not in ((4,), (9,), (3, 3)) or found.dtype.kind not in "fiu":
        expected = (
            "fx, fy, cx, cy in pixels, a (3, 3) camera matrix or its nine numbers by rows, or a"
            " mapping with the keys of a camera file"
        )
        raise ValueRangeError("intrinsics", _described(found), expected)
    if found.size == 9:  # a ROS CameraInfo has its matrix as nine numbers
        return CameraFile.from_matrix(Path("intrinsics"), found.reshape(3, 3))
    fx, fy, cx, cy = (float(number) for number in found)
    return CameraFile(fx, fy, cx, cy, origin="intrinsics")


def _as_json(value: Any) -> Any:  # noqa: ANN401 - of any type
    """Return `value` as a camera file would hold it: mappings, lists, numbers and text.

    Examples are the coefficients of OpenCV and of a `CameraInfo`, which are arrays, and the model
    of librealsense, an enum whose text is its name.
    """
    match value:
        case Enum():
            return value.name
        case None | bool() | int() | float() | str():
            return value.item() if isinstance(value, np.generic) else value
        case Mapping():
            return {str(key): _as_json(each) for key, each in value.items()}
        case _ if hasattr(value, "tolist"):
            return value.tolist()
        case Sequence():
            return [_as_json(each) for each in value]
        case _:
            return str(value)


def _stacked(stack: Mask) -> InstanceMasks:
    """Return the instances of (n, H, W) masks; a pixel of several masks belongs to the first."""
    background = np.ones_like(stack, shape=(1, *stack.shape[1:]))
    first = np.concatenate([stack, background]).argmax(axis=0)
    labels = np.where(first < len(stack), first + 1, 0).astype(np.int32)
    return InstanceMasks(labels, first=0)


def _array(name: str, values: object) -> NDArray[Any]:
    try:
        return np.asarray(values)
    except (TypeError, ValueError, RuntimeError) as error:
        # A tensor on a GPU or with a gradient, or rows of unequal lengths.
        raise ValueRangeError(name, f"no array ({error})", "an array that numpy accepts") from error


def _described(array: NDArray[Any]) -> str:
    if array.ndim == 0:
        return repr(array.item())
    return f"an array {array.shape} of {array.dtype}"
