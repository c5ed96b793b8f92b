"""Decide whether a surface is symmetric: how far its image lies from it, in distribution.

The mean alone cannot tell "all but the handle" from a noisy scan: a mug turned about its body's
axis misses by 0.3 % on average, but by more than 6 % at its 99th percentile. So a symmetry holds
when mean, 95th and 99th percentile of the distance do, and the normals agree.

Two things are not held against a symmetry. Noise: two noisy surfaces miss each other by what the
noise makes them miss, which is taken off in quadrature, and their normals need not agree better
than the surface's own do a little way off. Holes: what lies beyond an open rim is unknown, so
samples whose image lands there are left out, unless they are too many.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.transforms import rotation_about
from pipelines.mesh_symmetry.detection.surface import AGREEING_COSINE, Surface
from pipelines.mesh_symmetry.parts.open_boundary import cut_off, linked

# Worst of these decides whether a rotation is continuous; no n-gon up to 12 has all of them.
VERIFICATION_ANGLES = tuple(np.radians([25.0, 47.0, 77.0, 104.0, 131.0, 155.0, 180.0]))
# Of the diameter: a flat sheet is its own mirror image, and nothing follows from that.
MIN_DISPLACEMENT = 0.004
HOPELESS = 2.0  # times the limit of the mean
FAR = 0.15  # of the diameter; a larger miss is no worse than this one
SUPPORT_DISTANCE = 0.012  # of the diameter
SUPPORT_COSINE = AGREEING_COSINE  # of the image's normal and the surface's

# An octagonal column misses nothing at 45 degrees and most at 22; a dented can misses alike.
_ROUND_MEAN, _ROUND_RATIO = 0.002, 3.0
# Of the width: the misses of what is round stay below 1 %, those of ovals begin at 2.5 %.
_ROUND_ERROR = 0.017
# |N(0, 2)|, the distance of two surfaces of unit noise: its mean, 95th and 99th percentile.
_NOISE_MEAN, _NOISE_P95, _NOISE_P99 = 1.13, 2.77, 3.64
_RIM_REACH = 1.5  # spacings: the last sample that meets the surface is this near to its rim
_SPHERE_MEAN, _SPHERE_P95 = 0.01, 0.025  # of the diameter
_SPHERE_OFFCENTER, _SPHERE_MIN_SPREAD = 0.2, 0.2  # a cap is no sphere


@dataclass(frozen=True)
class Samples:
    """Surface samples in normalised coordinates: `points` and unit `normals`, both (n, 3).

    Where the surface has a rim, `links` (e, 2) are the pairs of neighbours among the samples, and
    `spacing` is how far apart neighbours lie.
    """

    points: Array
    normals: Array
    links: Indices | None = None
    spacing: float = 0.0

    @classmethod
    def with_links(cls, points: Array, normals: Array) -> "Samples":
        """Return the samples with the links between them."""
        links = linked(points)
        spacing = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1).mean()
        return cls(points, normals, links, float(spacing))


@dataclass(frozen=True)
class Fit:
    """How well an image fits its surface; distances are shares of the diameter.

    Measured where the image does not land beyond a rim; `unseen` is the share that does.
    """

    mean: float
    p95: float
    p99: float
    agreement: float  # share of samples whose image lies near, with the surface's normal
    displacement: float  # how far the farthest sample moves
    reach: float  # how far it moves at most: by half a turn
    unseen: float  # share of all samples
    noise: float  # of the surface about a smooth one, one sigma
    steadiness: float  # the agreement of the surface with itself, a little way off
    loss: float  # mean miss of all samples, those beyond a rim among them

    def holds(self, config: AnnotateSymmetryConfig, max_mean: float | None = None) -> bool:
        """Return whether the symmetry is one of the whole surface."""
        return (
            self.excess(self.mean, _NOISE_MEAN)
            <= (config.max_mean if max_mean is None else max_mean)
            and self.excess(self.p95, _NOISE_P95) <= config.max_p95
            and self.excess(self.p99, _NOISE_P99) <= config.max_p99
            and self.agreement >= config.min_agreement * self.steadiness
            and self.displacement >= MIN_DISPLACEMENT
            and self.miss <= config.max_error * self.reach
            and self.unseen <= config.max_unseen
        )

    def excess(self, statistic: float, of_noise: float) -> float:
        """Return what noise does not explain of a `statistic` that is `of_noise` for unit noise."""
        return float(np.sqrt(max(statistic**2 - (of_noise * self.noise) ** 2, 0.0)))

    def is_hopeless(self, config: AnnotateSymmetryConfig) -> bool:
        """Return whether no better samples could make this a symmetry: it misses by far."""
        return self.miss > HOPELESS * max(config.max_mean, config.max_axis_mean)

    @property
    def miss(self) -> float:
        """The mean distance that noise does not explain."""
        return self.excess(self.mean, _NOISE_MEAN)

    @property
    def ovalness(self) -> float:
        """What a turn misses of the width, over the most that what is round misses."""
        return self.miss / float(np.hypot(_ROUND_MEAN, _ROUND_ERROR * self.reach))

    @property
    def error(self) -> float:
        """Dense symmetry error of the surface against its image: miss over displacement."""
        return self.mean / max(self.displacement, 1e-9)


def mirrored(samples: Samples, normal: Array, offset: float) -> Samples:
    """Return the mirror image of `samples` in the plane n.x = d."""
    height = samples.points @ normal - offset
    return Samples(
        samples.points - 2.0 * height[:, None] * normal,
        samples.normals - 2.0 * (samples.normals @ normal)[:, None] * normal,
    )


def turned(samples: Samples, axis: Array, center: Array, angle: float) -> Samples:
    """Return `samples` turned by `angle` radians about the axis through `center`."""
    turn = rotation_about(axis, angle)
    return Samples((samples.points - center) @ turn.T + center, samples.normals @ turn.T)


def fit_of(surface: Surface, before: Samples, image: Samples, angle: float = np.pi) -> Fit:
    """Measure how well `image`, the image of `before`, fits `surface`; `angle` if turned."""
    distance, normals = surface.distances(image.points, reach=FAR)
    cosine = np.abs(np.einsum("nd,nd->n", normals, image.normals))
    seen = ~_unseen(surface, before, image, distance)
    loss, unseen = float(distance.mean()), 1.0 - float(seen.mean())
    if seen.any():
        distance, cosine = distance[seen], cosine[seen]
    p95, p99 = np.percentile(distance, [95.0, 99.0])
    displacement = float(np.linalg.norm(image.points - before.points, axis=1).max())
    return Fit(
        mean=float(distance.mean()),
        p95=float(p95),
        p99=float(p99),
        agreement=float(np.mean((distance < SUPPORT_DISTANCE) & (cosine > SUPPORT_COSINE))),
        displacement=displacement,
        reach=displacement / abs(float(np.sin(angle / 2.0))),
        unseen=unseen,
        noise=surface.noise,
        steadiness=surface.steadiness,
        loss=loss,
    )


def _unseen(surface: Surface, before: Samples, image: Samples, distance: Array) -> Mask:
    missed = distance > SUPPORT_DISTANCE
    if before.links is None or not missed.any():
        return np.zeros(len(distance), dtype=bool)
    return cut_off(
        missed, surface.rim.near(image.points, _RIM_REACH * before.spacing), before.links
    )


def are_round(fits: Sequence[Fit]) -> bool:
    """Return whether turns about one axis by generic angles all fit alike."""
    misses = [fit.miss for fit in fits]
    return bool(max(misses) <= np.hypot(_ROUND_MEAN, _ROUND_RATIO * min(misses)))


def is_sphere(points: Array, center: Array, radius: float) -> bool:
    """Return whether `points` (n, 3) cover the sphere: near it, and on all sides of its centre."""
    gap = np.abs(np.linalg.norm(points - center, axis=1) - radius)
    near = gap.mean() <= _SPHERE_MEAN and np.percentile(gap, 95.0) <= _SPHERE_P95
    return bool(near and surrounds(points, center))


def surrounds(points: Array, center: Array) -> bool:
    """Return whether `points` (n, 3) lie on all sides of `center` (3,)."""
    arm = points - center
    directions = arm / np.maximum(np.linalg.norm(arm, axis=1), 1e-9)[:, None]
    spread = np.linalg.eigvalsh(directions.T @ directions / len(points))
    offcenter = np.linalg.norm(directions.mean(axis=0))
    return bool(offcenter <= _SPHERE_OFFCENTER and spread[0] >= _SPHERE_MIN_SPREAD)
