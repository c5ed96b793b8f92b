"""Dense symmetry error in torch: the distance of points' images under two symmetries (D. 11).

All lengths share one arbitrary unit. Signs of normals and axes do not matter. There are B clouds,
with Q predictions, one truth and S points for the measurement each.
"""

import math

import torch
from torch import Tensor

TURNS = (math.pi / 2, math.pi, 3 * math.pi / 2)  # radians, among the turns that D. 11 averages
SMALL = 1e-8  # keeps the square root's gradient finite where two symmetries agree


def reflection_extent(
    points: Tensor,  # (B, S, 3)
    normal: Tensor,  # (B, 3)
    center: Tensor,  # (B, 3)
) -> Tensor:
    """Return max |S(x) - x| (B,) over the points, S the reflection in a plane."""
    heights = _heights(points, normal[:, None], center[:, None])[:, 0]
    return torch.amax(2.0 * heights.abs(), -1)


def rotation_extent(
    points: Tensor,  # (B, S, 3)
    axis: Tensor,  # (B, 3)
    center: Tensor,  # (B, 3)
) -> Tensor:
    """Return max |S(x) - x| (B,) over the points, S the half turn about an axis."""
    across = _across(points, axis[:, None], center[:, None])[:, 0]
    return torch.amax(2.0 * across.square().sum(1).sqrt(), -1)


def reflection_errors(
    points: Tensor,  # (B, S, 3)
    normal: Tensor,  # (B, Q, 3)
    center: Tensor,  # (B, Q, 3)
    true_normal: Tensor,  # (B, 3)
    true_center: Tensor,  # (B, 3)
) -> Tensor:
    """Return the mean over the points of |S_pred(x) - S_gt(x)|, (B, Q).

    With h the signed distance from each plane, the images differ by 2 (h' n' - h n). The length of
    this difference needs no image: |h' n' - h n|^2 = h'^2 + h^2 - 2 h' h (n' . n).
    """
    predicted = _heights(points, normal, center)
    true = _heights(points, true_normal[:, None], true_center[:, None])
    cosine = normal @ true_normal[..., None]  # (B, Q, 1)
    squared = predicted.square() + true.square() - 2.0 * predicted * true * cosine
    return 2.0 * torch.sqrt(squared.clamp(min=0.0) + SMALL).mean(-1)


def rotation_errors(
    points: Tensor,  # (B, S, 3)
    axis: Tensor,  # (B, Q, 3)
    center: Tensor,  # (B, Q, 3)
    true_axis: Tensor,  # (B, 3)
    true_center: Tensor,  # (B, 3)
) -> Tensor:
    """Return the mean over the points and `TURNS` of |S_pred(x) - S_gt(x)|, (B, Q).

    A turn by t moves x by a x_across + b (axis x x_across), a = cos t - 1, b = sin t. Two such
    moves differ by a u + b v; three products of u and v give its length for all turns.
    """
    true_axis, true_center = true_axis[:, None], true_center[:, None]
    sign = torch.where((axis * true_axis).sum(-1) < 0, -1.0, 1.0)[..., None, None]
    across, true = _across(points, axis, center), _across(points, true_axis, true_center)
    u, v = across - true, _cross(axis, across) - sign * _cross(true_axis, true)
    uu, vv, uv = u.square().sum(2), v.square().sum(2), (u * v).sum(2)
    errors = []
    for turn in TURNS:
        a, b = math.cos(turn) - 1.0, math.sin(turn)
        squared = a * a * uu + b * b * vv + 2.0 * a * b * uv
        errors.append(torch.sqrt(squared.clamp(min=0.0) + SMALL).mean(-1))
    return torch.stack(errors).mean(0)


def _heights(points: Tensor, normal: Tensor, center: Tensor) -> Tensor:
    """Return signed distances (B, Q, S) of points (B, S, 3) from planes (B, Q, 3)."""
    return torch.sub(normal @ points.transpose(1, 2), (normal * center).sum(-1, keepdim=True))


def _across(points: Tensor, axis: Tensor, center: Tensor) -> Tensor:
    """Return vectors (B, Q, 3, S) from axes (B, Q, 3) to points (B, S, 3), across the axis."""
    offset = points.transpose(1, 2)[:, None] - center[..., None]
    along = _heights(points, axis, center)[:, :, None]
    return torch.sub(offset, along * axis[..., None])


def _cross(axis: Tensor, vectors: Tensor) -> Tensor:
    """Return cross products (B, Q, 3, S) of axes (B, Q, 3) and `vectors`, faster than torch."""
    a, b, c = axis[..., None].unbind(2)
    x, y, z = vectors.unbind(2)
    return torch.stack([b * z - c * y, c * x - a * z, a * y - b * x], 2)
