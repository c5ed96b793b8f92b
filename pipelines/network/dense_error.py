"""Dense symmetry error in torch: where two symmetries send points, and how far apart (D. 11).

All lengths share one unit, any. Signs of normals and axes do not matter. B clouds, Q predictions
for each, one truth for each, S points on which the error is measured.
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
    return torch.amax(2.0 * across.square().sum(-1).sqrt(), -1)


def reflection_error(
    points: Tensor,  # (B, S, 3)
    normal: Tensor,  # (B, Q, 3)
    center: Tensor,  # (B, Q, 3)
    true_normal: Tensor,  # (B, 3)
    true_center: Tensor,  # (B, 3)
) -> Tensor:
    """Return the mean over the points of |S_pred(x) - S_gt(x)|, (B, Q).

    With h the signed distance from each plane, the images differ by 2 (h' n' - h n), whose length
    needs no image: |h' n' - h n|^2 = h'^2 + h^2 - 2 h' h (n' . n).
    """
    predicted = _heights(points, normal, center)
    true = _heights(points, true_normal[:, None], true_center[:, None])
    cosine = normal @ true_normal[..., None]  # (B, Q, 1)
    squared = predicted.square() + true.square() - 2.0 * predicted * true * cosine
    return 2.0 * torch.sqrt(squared.clamp(min=0.0) + SMALL).mean(-1)


def rotation_error(
    points: Tensor,  # (B, S, 3)
    axis: Tensor,  # (B, Q, 3)
    center: Tensor,  # (B, Q, 3)
    true_axis: Tensor,  # (B, 3)
    true_center: Tensor,  # (B, 3)
) -> Tensor:
    """Return the mean over the points and `TURNS` of |S_pred(x) - S_gt(x)|, (B, Q).

    A turn by t moves x by (cos t - 1) x_across + sin t (axis x x_across).
    """
    true_axis, true_center = true_axis[:, None], true_center[:, None]
    true_axis = torch.where((axis * true_axis).sum(-1, keepdim=True) < 0, -true_axis, true_axis)
    across, true = _across(points, axis, center), _across(points, true_axis, true_center)
    offset = across - true
    turned = _cross(axis, across) - _cross(true_axis, true)
    lengths = [(math.cos(turn) - 1.0) * offset + math.sin(turn) * turned for turn in TURNS]
    return torch.stack(
        [torch.sqrt(moved.square().sum(-1) + SMALL).mean(-1) for moved in lengths]
    ).mean(0)


def _heights(points: Tensor, normal: Tensor, center: Tensor) -> Tensor:
    """Signed distances (B, Q, S) of points (B, S, 3) from planes (B, Q, 3)."""
    return torch.sub(normal @ points.transpose(1, 2), (normal * center).sum(-1, keepdim=True))


def _across(points: Tensor, axis: Tensor, center: Tensor) -> Tensor:
    """Vectors (B, Q, S, 3) from axes (B, Q, 3) to points (B, S, 3), across the axis."""
    offset = points[:, None] - center[:, :, None]
    along = _heights(points, axis, center)[..., None]
    return torch.sub(offset, along * axis[:, :, None])


def _cross(axis: Tensor, vectors: Tensor) -> Tensor:
    crossed: Tensor = torch.linalg.cross(axis[:, :, None].expand_as(vectors), vectors)
    return crossed
