"""The eigenvector of the largest eigenvalue of symmetric 3 x 3 matrices, many at once.

Entries are the first axis, not the last: a product of many 3 x 3 matrices is then a few sums of
long rows. On a CPU without gradients a compiled loop does the same in a tenth of the time.
"""

from functools import reduce

import numpy as np
import torch
from torch import Tensor

from pipelines.array_types import Floats
from pipelines.geometry.numerics.compiled import compiled
from pipelines.network import devices

# As in `network.heads`; compiled loops read no constant of another file.
POWER_STEPS = 4  # squarings: a power of 16
POSITIVE_SHIFT, TINY_LENGTH, TINY_SQUARE = 1.2, 1e-6, 1e-24


def fast_leading_direction(
    six: Tensor,  # (..., 6)
) -> Tensor:
    """Return (..., 3), as `network.heads.leading_direction` does."""
    rows = six.movedim(-1, 0).contiguous()
    if devices.on_cpu(six) and not torch.is_grad_enabled():
        found = six.new_empty(3, *six.shape[:-1])
        _find_leading(rows.view(6, -1).numpy(), found.view(3, -1).numpy())
    else:
        found = _leading(rows)
    return found.movedim(0, -1)


def _leading(
    six: Tensor,  # (6, ...)
) -> Tensor:
    six = six / (_length(six) + TINY_LENGTH)
    power = (*(six[:3] + POSITIVE_SHIFT).unbind(), *six[3:].unbind())
    for _ in range(POWER_STEPS):
        # Never out of range: eigenvalues are between 0.6 and 2.2, their power of 16 is not large.
        power = _squared(*power)
    xx, yy, zz, xy, xz, yz = power
    column = torch.where(yy > xx, torch.stack([xy, yy, yz]), torch.stack([xx, xy, xz]))
    column = torch.where(zz > torch.maximum(xx, yy), torch.stack([xz, yz, zz]), column)
    return column / _length(column)


def _length(
    vectors: Tensor,  # (C, ...)
) -> Tensor:
    """Return lengths (...) that do not depend on a vector's place in its row.

    `Tensor.norm` is slow where C is not the last axis, and `sum` depends on the place.
    """
    squared: Tensor = reduce(torch.add, vectors.square())
    return (squared + TINY_SQUARE).sqrt()


def _squared(
    xx: Tensor, yy: Tensor, zz: Tensor, xy: Tensor, xz: Tensor, yz: Tensor
) -> tuple[Tensor, ...]:
    """Return the six numbers, each (...), of the squares of symmetric matrices."""
    # Not `addcmul`, which rounds a row's last elements otherwise than its first ones.
    xy_xy, xz_xz, yz_yz = xy * xy, xz * xz, yz * yz
    return (
        (xx * xx).add_(xy_xy).add_(xz_xz),
        (yy * yy).add_(xy_xy).add_(yz_yz),
        (zz * zz).add_(xz_xz + yz_yz),
        (xx * xy).add_(xy * yy).add_(xz * yz),
        (xx * xz).add_(xy * yz).add_(xz * zz),
        (xy * xz).add_(yy * yz).add_(yz * zz),
    )


@compiled
def _find_leading(six: Floats, found: Floats) -> None:
    """Set `found` (3, n) to the leading directions of `six` (6, n), as `_leading` does."""
    of = six.dtype.type
    shift, tiny, square = of(POSITIVE_SHIFT), of(TINY_LENGTH), of(TINY_SQUARE)
    for n in range(six.shape[1]):
        xx, yy, zz, xy, xz, yz = six[0, n], six[1, n], six[2, n], six[3, n], six[4, n], six[5, n]
        length = xx * xx + yy * yy + zz * zz + xy * xy + xz * xz + yz * yz
        length = np.sqrt(length + square) + tiny
        xx, yy, zz = xx / length + shift, yy / length + shift, zz / length + shift
        xy, xz, yz = xy / length, xz / length, yz / length
        for _ in range(POWER_STEPS):
            a, b, c = xy * xy, xz * xz, yz * yz
            xx, yy, zz, xy, xz, yz = (
                xx * xx + a + b,
                yy * yy + a + c,
                zz * zz + (b + c),
                xx * xy + xy * yy + xz * yz,
                xx * xz + xy * yz + xz * zz,
                xy * xz + yy * yz + yz * zz,
            )
        x, y, z = (xy, yy, yz) if yy > xx else (xx, xy, xz)
        x, y, z = (xz, yz, zz) if zz > max(xx, yy) else (x, y, z)
        length = np.sqrt(x * x + y * y + z * z + square)
        found[0, n], found[1, n], found[2, n] = x / length, y / length, z / length
