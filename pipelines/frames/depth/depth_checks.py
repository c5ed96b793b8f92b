"""Checks for implausible depth, by its flat surface and the objects on that surface.

A flat surface is affine in inverse depth. If it is instead affine in the stored numbers, these are
inverse depth or disparity. If the objects are behind the surface, near and far are swapped. If the
objects are as wide as a door or as narrow as a pencil, the unit is wrong (D. 126).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError

WIDTH = 160  # columns of a thinned image
FITTED = 4000  # pixels that the flat surface is fitted to
ITERATIONS = 200
REFITS = 5
FEWEST = 200  # pixels
# Of the median inverse depth; noise of sensors is some 0.003.
ON_SURFACE, OFF_SURFACE = 0.006, 0.02
SMALLEST = 30  # pixels of an object on the surface
ENCLOSED = 0.5  # least share of the surface in the surroundings of an object
# 35 real frames have 0.33 to 0.98; the same frames as inverse depth have 1.02 to 3.1.
FLATTER, AS_FLAT = 1.3, 1.0
PITS, MANY_PITS = 0.01, 0.05  # shares of the image; in the same frames at most 0.043
PITS_TO_OBJECTS = 5.0
LIKELY_SIZES = (0.015, 0.4)  # m, of the median object; in the same frames 0.056 to 0.23
LOOKS_INVERSE = (
    "the depth looks like inverse depth or disparity: flat surfaces are flat in its numbers, not "
    "in their inverse; save distances in metres, z = focal length x baseline / disparity"
)
SWAPPED = "objects on the flat surface appear behind it: near and far look swapped"
RAW_SUFFIXES = (".npy", ".npz", ".exr", ".tif", ".tiff", ".raw")  # that a picture may be next to
MISSING_DEPTH = 65535  # saturated in 16-bit files of several sensors
# Depth that many pixels share, this much farther than any other, may stand for missing depth, as
# 4095 or a renderer's far plane; 35 real frames have no such depth.
REPEATED, APART = 0.01, 1.2
COARSE = 0.015  # of the depth: steps between neighbouring values; sensors have 0.003 at 1 m

# SUN RGB-D rotates the bits of millimetres by 3, Kinect's first SDK shifts them: all numbers are
# multiples of 8 then. Depth of fewer values may be so by chance.
ROTATED_BITS, MULTIPLES, FEWEST_VALUES = 3, 0.95, 100
SAMPLED = 20_000  # pixels are enough for a share
# A depth buffer's numbers are 1 - near/z for a far plane far away; a near plane is some cm away.
BUFFER_START, BUFFER_QUANTILE = 0.9, 0.02

Values = NDArray[np.float64]


@dataclass(frozen=True)
class _Surface:
    """The flat surface with most pixels: x = a u + b v + c of thinned pixels."""

    affine: Values  # (3,)
    share: float  # share of the pixels that are on the surface

    def over(self, x: Values) -> Values:
        """Return by how much `x` (H, W) exceeds the surface."""
        rows, columns = np.indices(x.shape)
        return np.asarray(x - (self.affine[0] * columns + self.affine[1] * rows + self.affine[2]))


@dataclass(frozen=True)
class _ThinnedDepth:
    """Depth (H, W) of about `WIDTH` columns, nan where missing; metres, or any unit."""

    depth: Values

    @cached_property
    def inverse(self) -> Values:
        """Inverse depth (H, W), over its median."""
        return np.asarray(np.nanmedian(self.depth) / self.depth)

    @cached_property
    def surface(self) -> _Surface | None:
        """The flat surface; None if too few pixels are measured."""
        enough = np.count_nonzero(np.isfinite(self.depth)) >= FEWEST
        return _flat_surface(self.inverse) if enough else None

    def objects(self, over: Values) -> list[NDArray[np.bool_]]:
        """Return masks of the objects: parts of `over` above `OFF_SURFACE`, within the surface."""
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(
            (over > OFF_SURFACE).astype(np.uint8), connectivity=4
        )
        on, known = np.abs(over) < OFF_SURFACE / 2, np.isfinite(over)
        height, width = over.shape
        found = []
        for index in range(1, count):
            x, y, w, h, size = boxes[index]
            if size < SMALLEST or min(x, y) == 0 or x + w == width or y + h == height:
                continue
            mask = labels == index
            ring = cv2.dilate(mask.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
            ring &= ~mask & known
            if on[ring].sum() > ENCLOSED * ring.sum():
                found.append(mask)
        return found


def depth_oddities(depth: NDArray[np.float32], focal_length: float) -> list[str]:
    """Return reasons why `depth` (H, W), 0 = missing, cannot be distances in metres.

    Each reason is a sentence; `focal_length` is in pixels.
    """
    thinned = _thinned(depth)
    found = _steps(thinned.depth) + _far_constant(thinned.depth) + _buffer(thinned.depth)
    if thinned.surface is None:
        return found
    if (swapped := _swapped(thinned)) is not None:
        return [*found, swapped]
    metres = max(1, round(depth.shape[1] / WIDTH)) / focal_length  # width of a pixel at one metre
    objects = thinned.objects(thinned.surface.over(thinned.inverse))
    sizes = [np.sqrt(mask.sum()) * metres * np.nanmedian(thinned.depth[mask]) for mask in objects]
    size = float(np.median(sizes)) if sizes else LIKELY_SIZES[0]
    if not LIKELY_SIZES[0] <= size <= LIKELY_SIZES[1]:
        found.append(
            f"objects on the flat surface are {size:.2g} m wide, which no gripper can grasp: "
            "is the unit of the depth right (--depth-units-per-metre)?"
        )
    return found


def is_inverse(depth: NDArray[np.float32]) -> bool:
    """Return whether `depth` (H, W), in any unit, looks like inverse depth or disparity."""
    return _swapped(_thinned(depth)) == LOOKS_INVERSE


def _thinned(depth: NDArray[np.float32]) -> _ThinnedDepth:
    step = max(1, round(depth.shape[1] / WIDTH))
    kept = depth[::step, ::step].astype(np.float64)
    kept[kept <= 0] = np.nan
    return _ThinnedDepth(kept)


def _swapped(thinned: _ThinnedDepth) -> str | None:
    """Return a sentence if near and far are swapped."""
    if thinned.surface is None:
        return None
    over = thinned.surface.over(thinned.inverse)
    above, below = (sum(int(m.sum()) for m in thinned.objects(sign * over)) for sign in (1.0, -1.0))
    direct = _flat_surface(thinned.depth / np.nanmedian(thinned.depth))
    flatness = 0.0 if direct is None else direct.share / thinned.surface.share
    measured = np.count_nonzero(np.isfinite(thinned.depth))
    is_below = below > PITS_TO_OBJECTS * above and below > PITS * measured
    if flatness > FLATTER or (flatness > AS_FLAT and is_below):
        return LOOKS_INVERSE
    return SWAPPED if is_below and below > MANY_PITS * measured else None


def has_rotated_bits(values: NDArray[np.float32]) -> bool:
    """Return whether stored numbers are millimetres whose bits moved by 3; some are above 0."""
    known = values[values > 0]
    if known.max() >= MISSING_DEPTH:  # 16 bits hold no such number
        return False
    known = known[:: known.size // SAMPLED + 1]
    step = 2**ROTATED_BITS
    shares = [np.count_nonzero(known % each == 0) / known.size for each in (step, 2 * step)]
    is_shifted = bool(shares[0] >= MULTIPLES > shares[1])
    return is_shifted and len(np.unique(known)) >= FEWEST_VALUES


def one_channel(path: Path, stored: NDArray[Any]) -> NDArray[Any]:
    """Return `stored` as (H, W).

    Raises:
        FormatError: a picture of depth, or another array.
    """
    if stored.ndim == 3 and stored.shape[2] == 1:
        stored = stored[:, :, 0]
    if stored.ndim == 3 and stored.shape[2] in (3, 4):
        found = f"depth has {stored.shape[2]} channels, as a colourised picture has"
        raise FormatError(path, found, _raw_depth(path))
    if stored.ndim != 2 or stored.size == 0 or stored.dtype.kind not in "fiu":
        found = f"depth is an array {stored.shape} of {stored.dtype}"
        raise FormatError(path, found, "numbers of shape (height, width) are expected")
    if stored.dtype.itemsize == 1:
        raise FormatError(path, "depth has 8 bits", _raw_depth(path))
    return stored


def _raw_depth(picture: Path) -> str:
    """Return the way from a picture of the depth to the depth, which may be next to it."""
    suffixes = RAW_SUFFIXES if picture.suffix else ()  # an array has no file
    there = [each for each in suffixes if picture.with_suffix(each).is_file()]
    name = picture.with_suffix(there[0]).name if there else "the raw depth"
    if there and there[0] != ".raw":
        return f"remove it, so that {name} is read"
    return f"save {name} as a 16-bit PNG of one channel, in millimetres"


def nothing_measured(stored: NDArray[Any]) -> tuple[str, str]:
    """Return the fault of stored depth without a measured pixel, and what would be right."""
    below = float(np.mean(stored < 0))
    if below:
        return (
            f"{below:.0%} of the depths are below 0 and none is above, as along OpenGL's z axis",
            "save distances as positive numbers",
        )
    saturated = float(np.mean(stored == MISSING_DEPTH)) if stored.dtype.kind in "iu" else 0.0
    if not saturated:
        return "every pixel is missing (0, NaN or infinite)", "measure again"
    return (
        f"{saturated:.0%} of the pixels are 65535 and none is between 0 and 65535: the depth was "
        "saturated when it was saved, as metres or scaled numbers are",
        "save millimetres as whole numbers of 16 bits, or metres as floats",
    )


def _far_constant(depth: Values) -> list[str]:
    """Return a sentence if many pixels share one depth far behind all others."""
    values, counts = np.unique(depth[depth > 0], return_counts=True)
    if len(values) < 2 or values[-1] < APART * values[-2]:
        return []
    share = float(counts[-1] / counts.sum())
    if share < REPEATED:
        return []
    return [
        f"{share:.0%} of the depths are {values[-1]:.5g} m and all others are at most "
        f"{values[-2]:.3g} m: if that number stands for missing depth, save 0 instead"
    ]


def _steps(depth: Values) -> list[str]:
    """Return a sentence if depth has few distinct values, as in a picture of 8 bits."""
    values = np.unique(depth[depth > 0])
    if len(values) < 2:
        return []
    middle = int(np.searchsorted(values, np.median(depth[depth > 0])))
    around = values[max(0, middle - 5) : middle + 6]
    step = float(np.median(np.diff(around)))
    if step < COARSE * float(around.mean()):
        return []
    return [f"the depth changes in steps of {1000 * step:.0f} mm, like depth saved with 8 bits"]


def _buffer(depth: Values) -> list[str]:
    """Return a sentence if depth lies in the last tenth below 1, as in a depth buffer."""
    known = depth[depth > 0]
    are_many = len(np.unique(known)) >= FEWEST_VALUES
    if not are_many or known.max() > 1.0 or np.quantile(known, BUFFER_QUANTILE) < BUFFER_START:
        return []
    return [
        f"all depths are between {BUFFER_START} and 1: if they are the numbers of a depth buffer "
        "(OpenGL, PyBullet), save far x near / (far - (far - near) x number), in metres"
    ]


def _flat_surface(x: Values) -> _Surface | None:
    """Return the surface x = a u + b v + c that contains most finite pixels of `x` (H, W).

    `x` has a median of 1. None if all drawn pixels are collinear.
    """
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(np.isfinite(x))
    drawn = rng.permutation(len(rows))[:FITTED]
    u, v = columns[drawn].astype(np.float64), rows[drawn].astype(np.float64)
    points, values = np.stack([u, v, np.ones(len(u))]), x[rows[drawn], columns[drawn]]
    triples = rng.integers(0, len(u), (ITERATIONS, 3))
    matrices = np.moveaxis(points[:, triples], 0, -1)
    sound = np.abs(np.linalg.det(matrices)) > 1.0
    if not sound.any():
        return None
    planes = np.linalg.solve(matrices[sound], values[triples][sound][..., None])[..., 0]
    best = planes[(np.abs(planes @ points - values) < ON_SURFACE).sum(axis=1).argmax()]
    for _ in range(REFITS):
        on = np.abs(best @ points - values) < ON_SURFACE
        best = np.linalg.lstsq(points[:, on].T, values[on], rcond=None)[0]
    return _Surface(best, float((np.abs(best @ points - values) < ON_SURFACE).mean()))
