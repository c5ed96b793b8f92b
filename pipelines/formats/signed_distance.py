"""Signed-distance grids as text, `textured.sdf` (dex-net's format).

Line 1 "nx ny nz", line 2 the origin, line 3 the spacing, then nx * ny * nz values, one a line,
x fastest; metres, object frame, negative inside. Node (i, j, k) lies at origin + spacing (i, j, k).
"""

from pathlib import Path

import numpy as np

from pipelines.errors import FormatError
from pipelines.formats.files import atomic_path, existing
from pipelines.geometry.signed_distance import SignedDistanceGrid

HEADER_NUMBERS = 7


def write_sdf(path: Path, grid: SignedDistanceGrid) -> None:
    """Write `grid` with six significant digits, the original's precision."""
    nx, ny, nz = grid.values.shape
    ox, oy, oz = grid.origin
    header = f"{nx} {ny} {nz}\n{ox:.6g} {oy:.6g} {oz:.6g}\n{grid.spacing:.6g}\n"
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as stream:
        stream.write(header)
        for k in range(nz):
            values = grid.values[:, :, k].flatten(order="F").tolist()
            stream.write("\n".join(map("{:.6g}".format, values)) + "\n")


def read_sdf(path: Path) -> SignedDistanceGrid:
    """Read a grid written by `write_sdf`, dex-net or SDFGen."""
    try:
        numbers = np.array(existing(path).read_text(encoding="ascii").split(), dtype=np.float64)
    except (UnicodeDecodeError, ValueError) as error:
        raise FormatError(
            path, f"not a list of numbers ({error})", "SDFGen text is expected"
        ) from error
    if len(numbers) < HEADER_NUMBERS:
        raise FormatError(
            path,
            f"only {len(numbers)} numbers",
            "nx ny nz, origin, spacing and values are expected",
        )
    shape = tuple(int(n) for n in numbers[:3])
    values = numbers[HEADER_NUMBERS:]
    if len(values) != np.prod(shape):
        raise FormatError(path, f"{len(values)} values", f"a grid of {shape} has {np.prod(shape)}")
    return SignedDistanceGrid(
        values.reshape(shape, order="F"), numbers[3:6].copy(), float(numbers[6])
    )
