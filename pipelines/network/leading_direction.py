"""The eigenvector of the largest eigenvalue of symmetric 3 x 3 matrices, many at once.

Entries are the first axis, not the last: a product of many 3 x 3 matrices is then a few sums of
long rows.
"""

from functools import reduce

import torch
from torch import Tensor

POWER_STEPS = 4  # squarings: the second eigenvalue fades as its ratio to the first, to the 16th
POSITIVE_SHIFT = 1.2  # no eigenvalue of a matrix with six numbers of unit length is below -1.2
TINY_LENGTH, TINY_SQUARE = 1e-6, 1e-24  # finite quotients and gradients at zero


def leading_direction(
    six: Tensor,  # (..., 6)
) -> Tensor:
    """Return the unit eigenvector (..., 3) of the largest eigenvalue of a symmetric matrix.

    `six` holds xx, yy, zz, xy, xz, yz. A high power of the matrix, made positive, has columns that
    are all along that eigenvector; the longest is taken. So there is a gradient everywhere, also
    where two eigenvalues are equal.
    """
    rows = six.movedim(-1, 0).contiguous()
    rows = rows / (_length(rows) + TINY_LENGTH)
    power = (*(rows[:3] + POSITIVE_SHIFT).unbind(), *rows[3:].unbind())
    for _ in range(POWER_STEPS):
        # Never out of range: eigenvalues are between 0.6 and 2.2, their power of 16 is not large.
        power = _squared(*power)
    xx, yy, zz, xy, xz, yz = power
    column = torch.where(yy > xx, torch.stack([xy, yy, yz]), torch.stack([xx, xy, xz]))
    column = torch.where(zz > torch.maximum(xx, yy), torch.stack([xz, yz, zz]), column)
    return (column / _length(column)).movedim(0, -1)


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
