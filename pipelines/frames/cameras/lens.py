"""Lens distortion by OpenCV's models, removed from images.

Coefficients are in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, s1 to s4, tx, ty; for a fisheye
lens k1 to k4. Undistorted images keep the size and the camera matrix.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.errors import FormatError
from pipelines.geometry.camera import Intrinsics

BROWN, FISHEYE = "Brown-Conrady", "fisheye"
# Names of models in ROS, Kalibr, COLMAP, nerfstudio, ORB-SLAM and librealsense.
MODELS = {
    **dict.fromkeys(("plumb_bob", "radtan", "brown_conrady", "modified_brown_conrady"), BROWN),
    **dict.fromkeys(("rational_polynomial", "thin_prism", "radial_tangential"), BROWN),
    **dict.fromkeys(("opencv", "full_opencv", "pinhole", "simple_pinhole", "perspective"), BROWN),
    **dict.fromkeys(("simple_radial", "radial", "pinhole_radtan"), BROWN),
    **dict.fromkeys(("equidistant", "fisheye", "opencv_fisheye", "kannala_brandt4"), FISHEYE),
    **dict.fromkeys(("equi", "pinhole_equi", "kannalabrandt8"), FISHEYE),
    # Its coefficients too lead from a ray to a pixel: librealsense aligns depth with them so.
    "inverse_brown_conrady": BROWN,
}
MODEL_KEYS = ("distortion_model", "camera_model", "Camera.type", "model")
# Parts of the names of lens models that are not read. Another `model` is that of the device.
OTHER_MODELS = re.compile(r"^distortion\.|fish|prism|radial|fov|omni|sphere|unified|theta|eucm")
LIST_KEYS = ("D", "d", "distortion_coefficients", "Distortion_Coefficients", "distortion_coeffs",
             "distortion_coeff", "dist_coeffs", "dist_coeff", "dist_coefs", "distCoeffs",
             "distortionCoeff", "distortionCoefficients", "dist", "distortion",
             "coeffs")  # fmt: skip
OTHER_KEYS = re.compile(r"distort|dist_?co|dist_?param|radial|tangential", re.IGNORECASE)
OWN_LIST_KEYS = ("data", "coefficients", *LIST_KEYS)  # in a mapping below one of LIST_KEYS
NAMED = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
NAMED_FISHEYE = ("k1", "k2", "k3", "k4")
SIZES = {BROWN: (4, 5, 8, 12, 14), FISHEYE: (4,)}  # OpenCV's
UNNOTICED = 0.5  # pixels: a smaller shift leads to the same nearest pixel
BEYOND = -1e6  # pixels: outside of every image
WIDEST_GAP = 2.0  # pixels, between pixels of an image that a lens spreads out
RADII = 1000  # samples between the axis and the farthest corner

Image = TypeVar("Image", bound=NDArray[Any])
Places = NDArray[np.float32]


@dataclass(frozen=True)
class Distortion:
    """Distortion of the image of a pinhole camera by a lens; none without coefficients."""

    model: str = BROWN
    coefficients: tuple[float, ...] = ()

    @property
    def is_known(self) -> bool:
        """Whether distortion of this model can be removed."""
        return self.model in SIZES


NO_DISTORTION = Distortion()


def distortion_in(path: Path, content: Mapping[str, Any]) -> Distortion:
    """Return the distortion that the keys of a camera file state; none without such keys.

    Raises:
        FormatError: too many coefficients, some that are not finite, or no list of them.
        TypeError, ValueError: coefficients that are no numbers.
    """
    mappings = (content[key] for key in LIST_KEYS if isinstance(content.get(key), dict))
    below: Mapping[str, Any] = next(mappings, {})
    own = below.get("model") or content.get("distortion_model")
    facts = {**content, "distortion_model": own, **below}
    model = _model(facts)
    lists = [*(below.get(key) for key in OWN_LIST_KEYS), *(content.get(key) for key in LIST_KEYS)]
    if (other := _stated_otherwise(lists)) is not None:
        found = f"states distortion coefficients as {other!r}"
        raise FormatError(path, found, "a list of numbers is expected")
    values = _coefficients(facts, lists, model)
    if not np.isfinite(values).all():
        raise FormatError(path, "has distortion coefficients that are not finite", "numbers")
    values = np.trim_zeros(values, "b")
    if model in SIZES and values.size > SIZES[model][-1]:
        found = f"has {values.size} distortion coefficients of the model {model}"
        raise FormatError(path, found, f"at most {SIZES[model][-1]} are expected")
    return Distortion(model, tuple(values.tolist())) if values.size else _unread(content)


def _unread(content: Mapping[str, Any]) -> Distortion:
    """Return distortion whose key is named after it but is not read, as of an unknown model."""
    for key, stored in content.items():
        if OTHER_KEYS.search(key) and key not in LIST_KEYS and isinstance(stored, list):
            rows = (each if isinstance(each, list) else [each] for each in stored)
            numbers = (each for each in chain.from_iterable(rows) if isinstance(each, int | float))
            if coefficients := tuple(filter(None, numbers)):
                return Distortion(key, coefficients)
    return NO_DISTORTION


def _model(content: Mapping[str, Any]) -> str:
    """Return the model that the keys state first, as named if it is unknown; else Brown-Conrady."""
    for key in MODEL_KEYS:
        name = content.get(key)
        plain = _plain(name) if isinstance(name, str) else ""
        if plain in MODELS:
            return MODELS[plain]
        is_model = key != "model" or OTHER_MODELS.search(str(name).lower())
        if plain not in ("", "none") and is_model:
            return str(name)
    return BROWN


def _plain(name: str) -> str:
    return name.rpartition(".")[2].strip().lower().replace("-", "_").replace(" ", "_")


def _stated_otherwise(lists: list[Any]) -> object:
    """Return the value among `lists` that is no list, mapping or name of a model; None if none is.

    0, false and empty values state that there is no distortion.
    """
    others = (each for each in lists if each and not isinstance(each, list | dict))
    names = (*MODELS, "none")
    return next((o for o in others if not (isinstance(o, str) and _plain(o) in names)), None)


def _coefficients(content: Mapping[str, Any], lists: list[Any], model: str) -> Array:
    """Return the coefficients in the first of `lists` that is a list, else those by name."""
    stored = next((each for each in lists if isinstance(each, list)), None)
    if stored is not None:
        return np.asarray(stored, np.float64).ravel()
    names = NAMED_FISHEYE if model == FISHEYE else NAMED
    return np.array([float(content.get(name) or 0.0) for name in names])


def undistorted(image: Image, camera: Intrinsics, distortion: Distortion, *, smooth: bool) -> Image:
    """Return `image` (H, W) or (H, W, 3) as seen by a lens without distortion, 0 outside.

    `smooth`: interpolate between pixels, for colour; else take the nearest pixel, for depth and
    instance ids, which have no meaningful mean.
    """
    u, v = _places(camera, distortion)
    if smooth:
        moved = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return cast(Image, np.asarray(moved, image.dtype))
    inside, places = _nearest_pixels(u, v)
    nearest = np.zeros_like(image)
    nearest[inside] = image[places]
    return cast(Image, nearest)


def distorted(image: Image, camera: Intrinsics, distortion: Distortion) -> Image:
    """Return `image` (H, W) or (H, W, 3) as the lens shows it, 0 outside of its view.

    Every pixel that `undistorted` takes has a value; a gap between such pixels has the nearest.
    """
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415 - slow to import, rarely used

    inside, places = _nearest_pixels(*_places(camera, distortion))
    shown, is_gap = np.zeros_like(image), np.ones(image.shape[:2], np.bool_)
    shown[places], is_gap[places] = image[inside], False
    far, nearest = distance_transform_edt(is_gap, return_indices=True)
    shown = shown[tuple(nearest)]
    shown[far > WIDEST_GAP] = 0
    return cast(Image, shown)


def _nearest_pixels(u: Places, v: Places) -> tuple[Mask, tuple[NDArray[np.int64], ...]]:
    """Return which of the places (H, W) are in the image, and the rows and columns of these."""
    height, width = u.shape
    columns, rows = np.rint(u).astype(np.int64), np.rint(v).astype(np.int64)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return inside, (rows[inside], columns[inside])


def displacement(camera: Intrinsics, distortion: Distortion) -> float:
    """Return the largest shift of a pixel by the distortion, in pixels; 0 if it is negligible."""
    if not distortion.coefficients or not distortion.is_known:
        return 0.0
    u, v = _places(camera, distortion)
    columns, rows = np.arange(camera.width), np.arange(camera.height)[:, None]
    most = float(np.hypot(u - columns, v - rows)[u > BEYOND].max(initial=0.0))
    return most if most >= UNNOTICED else 0.0


@lru_cache(maxsize=2)  # frames of one camera share the result
def _places(camera: Intrinsics, distortion: Distortion) -> tuple[Places, Places]:
    """Return the place of each undistorted pixel in the distorted image, columns and rows (H, W).

    BEYOND outside of the view of the lens.
    """
    rays = camera.rays()[..., :2].reshape(-1, 1, 2)
    bent = _bend(rays, distortion)
    u = (camera.fx * bent[:, 0, 0] + camera.cx).astype(np.float32)
    v = (camera.fy * bent[:, 0, 1] + camera.cy).astype(np.float32)
    radii = np.linalg.norm(rays[:, 0], axis=1)
    beyond = radii > _reach(float(radii.max()), distortion)
    beyond |= ~(np.isfinite(u) & np.isfinite(v))
    u[beyond] = v[beyond] = BEYOND
    shape = camera.height, camera.width
    return u.reshape(shape), v.reshape(shape)


def _bend(rays: Array, distortion: Distortion) -> Array:
    """Return the distorted points of rays (n, 1, 2), both at depth 1."""
    size = next(size for size in SIZES[distortion.model] if size >= len(distortion.coefficients))
    D = np.zeros(size)
    D[: len(distortion.coefficients)] = distortion.coefficients
    if distortion.model == FISHEYE:
        radius = np.linalg.norm(rays, axis=2, keepdims=True)
        angle = np.arctan(radius)
        series = np.polynomial.polynomial.polyval(angle**2, [1.0, *D])
        shrinking = np.where(radius > 0, angle / np.where(radius > 0, radius, 1.0), 1.0)
        return np.asarray(rays * shrinking * series, np.float64)
    one, still = np.eye(3), np.zeros(3)
    points = cv2.convertPointsToHomogeneous(rays)
    return np.asarray(cv2.projectPoints(points, still, still, one, D)[0], np.float64)


def _reach(farthest: float, distortion: Distortion) -> float:
    """Return the radius up to which farther rays are farther out in the distorted image.

    Beyond it a polynomial decreases again, and the same pixels would be used twice.
    """
    values = list(distortion.coefficients)
    if distortion.model == BROWN:
        values = [k if name[0] == "k" else 0.0 for k, name in zip(values, NAMED, strict=False)]
    radial = Distortion(distortion.model, tuple(values))
    radii = np.linspace(0.0, farthest, RADII)
    rays = np.stack([radii, np.zeros(RADII)], axis=-1)[:, None]
    turns = np.flatnonzero(~(np.diff(_bend(rays, radial)[:, 0, 0]) > 0))
    return float(radii[turns[0]]) if len(turns) else np.inf
