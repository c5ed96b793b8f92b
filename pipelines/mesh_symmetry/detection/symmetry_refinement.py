"""Refinement of candidate planes and axes by robust point-to-plane Gauss-Newton.

All candidates take their steps together. Tukey's weight limits the fit to the part of the surface
near its image, so the axis of a body is found in spite of a handle.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

from collections.abc import Sequence

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.transforms import basis_from_direction, rotation_about, unit
from pipelines.mesh_symmetry.surface.sampled_surface import Surface

DAMPING = 1e-6  # of the trace of the normal equations, against singular ones
MAX_TILT = 0.15  # radians a step
MAX_SHIFT = 0.05  # of the diameter a step
SPHERE_STEPS = 5  # reweighted fits


def refine_planes(
    surface: Surface, points: Array, normals: Array, offsets: Array, scales: Sequence[float]
) -> tuple[Array, Array]:
    """Return refined normals (c, 3) and offsets (c,) of the planes n.x = d.

    `points`: (n, 3) samples of `surface`; one step is taken for each Tukey scale of `scales`
    (shares of the diameter, falling).
    """
    for scale in scales:
        reach = points @ normals.T  # (n, c)
        height = (reach - offsets).T[..., None]  # (c, n, 1)
        image = points[None] - 2.0 * height * normals[:, None]
        tangents = _tangents(normals)  # (c, 2, 3)
        residual, met, weight = _compare(surface, image, scale)
        along = np.einsum("cnd,cd->cn", met, normals)
        columns = [
            -2.0 * ((points @ tangent.T).T * along)
            - 2.0 * height[..., 0] * np.einsum("cnd,cd->cn", met, tangent)
            for tangent in (tangents[:, 0], tangents[:, 1])
        ]
        step = _solve(np.stack([*columns, 2.0 * along], axis=-1), residual, weight)
        tilt = np.einsum("ck,ckd->cd", _clipped(step[:, :2], MAX_TILT), tangents)
        normals = unit(normals + tilt)
        offsets = offsets + _clipped(step[:, 2:], MAX_SHIFT)[:, 0]
    return normals, offsets


def refine_axes(
    surface: Surface,
    points: Array,
    axes: Array,
    centers: Array,
    angles: Sequence[float],
    scales: Sequence[float],
) -> tuple[Array, Array]:
    """Return refined directions (c, 3) and points (c, 3) of axes, turning by `angles` radians.

    `points`: (n, 3) samples. `axes`, `centers`: (c, 3) directions and points before.

    One step is taken for each Tukey scale of `scales`. For an n-fold axis pass the single angle
    2 pi / n, for a continuous axis several generic angles.
    """
    for scale in scales:
        tangents = _tangents(axes)
        system = [
            _turn_equations(surface, points, axes, centers, tangents, float(angle), scale)
            for angle in angles
        ]
        jacobian, residual, weight = (
            np.concatenate(part, axis=1) for part in zip(*system, strict=True)
        )
        step = _solve(jacobian, residual, weight)
        tilt = np.einsum("ck,ckd->cd", _clipped(step[:, :2], MAX_TILT), tangents)
        axes = unit(axes + np.cross(tilt, axes))
        centers = centers + np.einsum("ck,ckd->cd", _clipped(step[:, 2:], MAX_SHIFT), tangents)
    return axes, centers


def robust_sphere(points: Array) -> tuple[Array, float]:
    """Return centre (3,) and radius of the sphere that fits most of `points` (n, 3)."""
    weight = np.ones(len(points))
    for _ in range(SPHERE_STEPS):
        # |x|^2 = 2 c.x + (r^2 - |c|^2) is linear in the centre c and in r^2 - |c|^2.
        system = np.column_stack([2.0 * points, np.ones(len(points))]) * weight[:, None]
        solution = np.linalg.lstsq(system, (points**2).sum(axis=1) * weight, rcond=None)[0]
        center = solution[:3]
        radius = float(np.sqrt(max(solution[3] + center @ center, 0.0)))
        gap = np.abs(np.linalg.norm(points - center, axis=1) - radius)
        weight = 1.0 / (1.0 + (gap / (1e-6 + 2.0 * np.median(gap))) ** 2)
    return center, radius


def _turn_equations(
    surface: Surface,
    points: Array,
    axes: Array,
    centers: Array,
    tangents: Array,
    angle: float,
    scale: float,
) -> tuple[Array, Array, Array]:
    """Return jacobian (c, n, 4), residual (c, n) and weight (c, n) of a turn by `angle`."""
    turn = rotation_about(axes, angle)  # (c, 3, 3)
    arm = points[None] - centers[:, None]
    turned = arm @ turn.swapaxes(1, 2)
    residual, met, weight = _compare(surface, turned + centers[:, None], scale)
    columns = []
    for tangent in (tangents[:, 0], tangents[:, 1]):
        # Tilting the axis by w turns R into exp(w) R exp(-w): dx = w x Rx - R (w x x).
        before = np.cross(tangent[:, None], arm) @ turn.swapaxes(1, 2)
        columns.append(_dot(met, np.cross(tangent[:, None], turned) - before))
    for tangent in (tangents[:, 0], tangents[:, 1]):
        shift = tangent - np.einsum("cij,cj->ci", turn, tangent)
        columns.append(_dot(met, shift[:, None]))
    return np.stack(columns, axis=-1), residual, weight


def _compare(surface: Surface, image: Array, scale: float) -> tuple[Array, Array, Array]:
    """Return residual (c, n), surface normals (c, n, 3) and Tukey weights (c, n) of `image`."""
    distance, index = surface.within(image, 2.0 * scale)  # farther away, the weight is zero
    met = surface.normals[index]
    residual = np.where(np.isfinite(distance), _dot(image - surface.points[index], met), 0.0)
    # Samples are sparse, so only the part of the gap along the normal is a residual.
    far = np.maximum(np.abs(residual), distance - scale)
    weight = np.square(np.clip(1.0 - np.square(far / scale), 0.0, None))
    return residual, met, weight


def _solve(jacobian: Array, residual: Array, weight: Array) -> Array:
    """Return the weighted least-squares steps (c, k)."""
    weighted = jacobian * weight[..., None]
    normal = np.einsum("cni,cnj->cij", weighted, jacobian)
    right = -np.einsum("cni,cn->ci", weighted, residual)
    count = jacobian.shape[-1]
    trace = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    damped = normal + (DAMPING * trace + 1e-12) * np.eye(count)
    step: Array = np.linalg.solve(damped, right[..., None])[..., 0]
    return step


def _clipped(step: Array, limit: float) -> Array:
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, limit / np.maximum(length, 1e-12)))


def _tangents(directions: Array) -> Array:
    return basis_from_direction(directions).swapaxes(1, 2)[:, 1:]


def _dot(a: Array, b: Array) -> Array:
    product: Array = np.einsum("...d,...d->...", a, b)
    return product
