"""Signed-distance grids as text, `textured.sdf` (dex-net's format).

Line 1 is "nx ny nz", line 2 the origin, line 3 the spacing, then nx * ny * nz values, one per line,
x fastest; metres, object frame, negative inside. Node (i, j, k) is at origin + spacing (i, j, k).
"""

from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.errors import FormatError, counted
from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid
from pipelines.storage.files import atomic_path, existing

LARGEST = 1e6  # cells along a side, metres
HEADER_NUMBERS = 7
DIGITS = 6  # significant, the original's precision
EXACT_POWER = 22  # the largest power of ten that a float64 holds exactly


def write_sdf(path: Path, grid: SignedDistanceGrid) -> None:
    """Write `grid` with `DIGITS` significant digits."""
    nx, ny, nz = grid.values.shape
    ox, oy, oz = grid.origin
    header = f"{nx} {ny} {nz}\n{ox:.6g} {oy:.6g} {oz:.6g}\n{grid.spacing:.6g}\n"
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as stream:
        stream.write(header)
        for k in range(nz):
            values = grid.values[:, :, k].flatten(order="F").tolist()
            stream.write("\n".join(map("{:.6g}".format, values)) + "\n")


def as_stored(grid: SignedDistanceGrid) -> SignedDistanceGrid:
    """Return `grid` with the precision of a file by `write_sdf`."""
    spacing = float(_rounded(np.array([grid.spacing]))[0])
    return SignedDistanceGrid(_rounded(grid.values), _rounded(grid.origin), spacing)


def _rounded(values: Array) -> Array:
    """Return `values` rounded to `DIGITS` digits, bit for bit as read from their text."""
    size = np.abs(np.where(values == 0.0, 1.0, values))
    shift = DIGITS - 1 - np.floor(np.log10(size))
    scale = 10.0**shift
    rounded = np.asarray(np.rint(values * scale) / scale)
    tiny = shift > EXACT_POWER
    rounded[tiny] = [float(f"{value:.{DIGITS}g}") for value in values[tiny]]
    return rounded


def read_sdf(path: Path) -> SignedDistanceGrid:
    """Read a grid written by `write_sdf`, dex-net or SDFGen."""
    try:
        numbers = np.array(existing(path).read_text(encoding="ascii").split(), dtype=np.float64)
    except (UnicodeDecodeError, ValueError) as error:
        raise FormatError(
            path, f"not a list of numbers ({error})", "SDFGen text is expected"
        ) from error
    if len(numbers) < HEADER_NUMBERS:
        found = f"only {counted(len(numbers), 'number')}"
        raise FormatError(path, found, "nx ny nz, origin, spacing and values are expected")
    shape, spacing = tuple(int(n) for n in numbers[:3] if 1 <= n < LARGEST), numbers[6]
    is_placed = (np.abs(numbers[3:HEADER_NUMBERS]) < LARGEST).all() and spacing > 0
    if len(shape) < 3 or not is_placed:
        raise FormatError(path, "a header without a size", "nx ny nz, origin, spacing")
    values = numbers[HEADER_NUMBERS:]
    if len(values) != np.prod(shape):
        raise FormatError(
            path, counted(len(values), "value"), f"a grid of {shape} has {np.prod(shape)}"
        )
    if not np.isfinite(values).all():
        raise FormatError(path, "distances that are not finite", "metres are expected")
    return SignedDistanceGrid(values.reshape(shape, order="F"), numbers[3:6].copy(), float(spacing))
