"""Verification of a symmetry by the distances of a surface's image from the surface.

The mean distance does not distinguish a missing handle from a noisy scan: a mug turned about the
axis of its body misses by 0.3 % on average, but by more than 6 % at the 99th percentile. So a
symmetry holds if mean, 95th and 99th percentile are small and the normals agree.

Two causes of distance do not count. Noise: its part is subtracted in quadrature, and normals need
not agree better than normals of neighbours on the surface. Holes: the surface beyond an open rim is
unknown, so samples with an image beyond a rim are left out, unless there are too many.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.transforms import rotation_about
from pipelines.mesh_symmetry.surface.open_boundary import cut_off, linked
from pipelines.mesh_symmetry.surface.sampled_surface import AGREEING_COSINE, Surface

# The worst angle decides whether a rotation is continuous; no n-gon up to 12 fits all angles.
VERIFICATION_ANGLES = tuple(np.radians([25.0, 47.0, 77.0, 104.0, 131.0, 155.0, 180.0]))
# Of the diameter: excludes the plane of a flat sheet, which is its own mirror image.
MIN_DISPLACEMENT = 0.004
HOPELESS = 2.0  # times the limit of the mean
MAX_DISTANCE = 0.15  # of the diameter; cap of distances
SUPPORT_DISTANCE = 0.012  # of the diameter
SUPPORT_COSINE = AGREEING_COSINE  # between the normals of image and surface

# An octagonal column fits at 45 degrees and misses at 22; a dented can misses at all angles alike.
ROUND_MEAN, ROUND_RATIO = 0.002, 3.0
# Of the width: misses of round objects stay below 1 %, misses of ovals begin at 2.5 %.
ROUND_ERROR = 0.017
# Objects narrower than this share of the diameter get a smaller limit, down to this factor on it.
SLIM_WIDTH, SLIMMEST = 0.33, 0.7
MAX_FEATURE = 0.14  # of the width
TURN_P99 = 1.2  # times the limit of planes: a dented jar with a hole misses by 0.051 of 0.044
# Times the limit, at a single angle: grooves of a cup meet at some angles and miss at others.
LEAST_AGREEMENT = 0.5
# |N(0, 2)|, the distance of two surfaces of unit noise: its mean, 95th, 99th, 99.5th percentile.
NOISE_MEAN, NOISE_P95, NOISE_P99, NOISE_P995 = 1.13, 2.77, 3.64, 3.97
# Loose parts on 1 % of a box miss by 0.067 to 0.080, real objects by up to 0.054.
MAX_P995 = 0.06
RIM_REACH = 1.5  # sample spacings from a rim within which an image is at the rim
RIM_SLACK = 0.5  # of RIM_REACH, by which the rim may be farther than the surface


@dataclass(frozen=True)
class Samples:
    """Surface samples in normalised coordinates: `points` and unit `normals`, both (n, 3).

    For a surface with a rim, `links` (e, 2) are pairs of neighbouring samples, and `spacing` is
    their mean distance.
    """

    points: Array
    normals: Array
    links: Indices | None = None
    spacing: float = 0.0

    @classmethod
    def with_links(cls, points: Array, normals: Array) -> "Samples":
        """Return the samples `points` and `normals`, both (n, 3), with links between neighbours."""
        links = linked(points)
        spacing = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1).mean()
        return cls(points, normals, links, float(spacing))


@dataclass(frozen=True)
class SurfaceFit:
    """Distances of a surface's image from the surface, as shares of the diameter.

    Samples with an image beyond a rim are left out, except from `unseen` and `loss`.
    """

    mean: float
    p95: float
    p99: float
    p995: float
    agreement: float  # share of samples with an image near the surface and agreeing normals
    displacement: float  # largest displacement of a sample
    reach: float  # largest displacement by half a turn
    unseen: float  # share of samples with image beyond a rim
    noise: float  # standard deviation of the surface from a smooth one
    own_agreement: float  # share of neighbouring samples whose normals agree
    loss: float  # mean distance of all samples

    def holds(self, config: AnnotateSymmetryConfig, max_mean: float | None = None) -> bool:
        """Return whether the whole surface has the symmetry."""
        mean = config.max_mean if max_mean is None else max_mean
        return self._is_within(config, mean) and self.miss <= config.max_error * self.reach

    def may_turn(self, config: AnnotateSymmetryConfig) -> bool:
        """Return whether the misses are allowed for one turn of a body of revolution.

        All angles together decide whether misses are small for the width, and normals agree.
        """
        return self._is_within(config, config.max_axis_mean, TURN_P99, LEAST_AGREEMENT)

    def _is_within(
        self,
        config: AnnotateSymmetryConfig,
        max_mean: float,
        p99_room: float = 1.0,
        agreement_share: float = 1.0,
    ) -> bool:
        """Return whether misses and normals are within the limits, two limits with factors."""
        return (
            self.miss <= max_mean
            and self.excess(self.p95, NOISE_P95) <= config.max_p95
            and self.excess(self.p99, NOISE_P99) <= p99_room * config.max_p99 * self._slimness
            and self.excess(self.p995, NOISE_P995) <= MAX_P995
            and self.agreement >= agreement_share * config.min_agreement * self.own_agreement
            and self.displacement >= MIN_DISPLACEMENT
            and self.unseen <= config.max_unseen
        )

    def is_small_beside_width(self, config: AnnotateSymmetryConfig) -> bool:
        """Return whether a turn's misses are small for the width everywhere: no clip, no bend."""
        has_feature = self.excess(self.p99, NOISE_P99) > MAX_FEATURE * self.reach
        return self.miss <= config.max_error * self.reach and not has_feature

    def excess(self, statistic: float, of_noise: float) -> float:
        """Return `statistic` without the part of noise; `of_noise`: statistic of unit noise."""
        return float(np.sqrt(max(statistic**2 - (of_noise * self.noise) ** 2, 0.0)))

    def is_hopeless(self, config: AnnotateSymmetryConfig) -> bool:
        """Return whether the misfit is so large that more samples are useless."""
        return self.miss > HOPELESS * max(config.max_mean, config.max_axis_mean)

    @property
    def miss(self) -> float:
        """Mean distance without the part of noise."""
        return self.excess(self.mean, NOISE_MEAN)

    @property
    def _slimness(self) -> float:
        """Factor on the limit of the worst misses, since a clip is large for a slim marker."""
        return float(np.clip(self.reach / SLIM_WIDTH, SLIMMEST, 1.0))

    @property
    def ovalness(self) -> float:
        """Misfit of a turn relative to the width, over the largest misfit of round objects."""
        return self.miss / float(np.hypot(ROUND_MEAN, ROUND_ERROR * self.reach))

    @property
    def error(self) -> float:
        """Dense symmetry error of the surface against its image: distance over displacement."""
        return self.mean / max(self.displacement, 1e-9)


def mirror_samples(samples: Samples, normal: Array, offset: float) -> Samples:
    """Return the mirror image of `samples` in the plane of `normal` (3,) and `offset`, n.x = d."""
    height = samples.points @ normal - offset
    return Samples(
        samples.points - 2.0 * height[:, None] * normal,
        samples.normals - 2.0 * (samples.normals @ normal)[:, None] * normal,
    )


def turn_samples(samples: Samples, axis: Array, center: Array, angle: float) -> Samples:
    """Return `samples` turned by `angle` radians about the axis through `center`."""
    turn = rotation_about(axis, angle)
    return Samples((samples.points - center) @ turn.T + center, samples.normals @ turn.T)


def fit_of(surface: Surface, before: Samples, image: Samples, angle: float = np.pi) -> SurfaceFit:
    """Measure the fit of `image`, the image of the samples `before`, to `surface`.

    `angle`: angle of the turn, radians; pi for a mirror image.
    """
    distance, normals = surface.distances(image.points, reach=MAX_DISTANCE)
    cosine = np.abs(np.einsum("nd,nd->n", normals, image.normals))
    seen = ~_unseen(surface, before, image, distance)
    loss, unseen = float(distance.mean()), 1.0 - float(seen.mean())
    if seen.any():
        distance, cosine = distance[seen], cosine[seen]
    p95, p99, p995 = np.percentile(distance, [95.0, 99.0, 99.5])
    displacement = float(np.linalg.norm(image.points - before.points, axis=1).max())
    return SurfaceFit(
        mean=float(distance.mean()),
        p95=float(p95),
        p99=float(p99),
        p995=float(p995),
        agreement=float(np.mean((distance < SUPPORT_DISTANCE) & (cosine > SUPPORT_COSINE))),
        displacement=displacement,
        reach=displacement / abs(float(np.sin(angle / 2.0))),
        unseen=unseen,
        noise=surface.noise,
        own_agreement=surface.agreement,
        loss=loss,
    )


def _unseen(surface: Surface, before: Samples, image: Samples, distance: Array) -> Mask:
    missed = distance > SUPPORT_DISTANCE
    if before.links is None or not missed.any():
        return np.zeros(len(distance), dtype=bool)
    reach = RIM_REACH * before.spacing
    to_rim = surface.rim.distances(image.points, MAX_DISTANCE + reach)
    # Beyond the cap of distances, the rim counts as nearest.
    is_nearest = (to_rim <= distance + RIM_SLACK * reach) | (distance >= MAX_DISTANCE)
    return cut_off(missed, to_rim < reach, is_nearest, before.links)


def normals_agree(fits: Sequence[SurfaceFit], config: AnnotateSymmetryConfig) -> bool:
    """Return whether normals agree over all turns about one axis together."""
    agreement = float(np.mean([fit.agreement for fit in fits]))
    return agreement >= config.min_agreement * fits[0].own_agreement


def are_round(fits: Sequence[SurfaceFit]) -> bool:
    """Return whether turns about one axis by generic angles fit equally well."""
    misses = [fit.miss for fit in fits]
    return bool(max(misses) <= np.hypot(ROUND_MEAN, ROUND_RATIO * min(misses)))
