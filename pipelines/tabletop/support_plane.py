"""The plane that things stand on, fitted in inverse depth to the pixels of a frame.

A plane is affine in inverse depth: 1/z = a u + b v + c. Stereo and structured light measure with
nearly constant noise there, so planes are fitted and judged in inverse depth, and a tolerance of
`t` metres at one metre means t z^2 metres at depth z.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.footprint import Footprint

Affine = tuple[float, float, float]  # a, b and c of 1/z = a u + b v + c

MAX_PLANES = 4  # candidates that are drawn one after the other
MAX_FINGERS = 4  # planes that are too small, between them
ITERATIONS = 300  # hypotheses a candidate
FITTED = 20000  # pixels, about, that planes are fitted to, evenly spread
SAMPLE = 4000  # of them that hypotheses are counted on
MIN_PIXELS = 200  # fewer show no plane
MAX_FITS = 20  # of a plane to the pixels near it, until these are the same
STRAY = 0.05  # share of pixels, the nearest, that count no more than the next


@dataclass(frozen=True)
class Support:
    """A plane over an image and in space."""

    affine: Affine
    plane: Plane


@dataclass(frozen=True)
class _Candidate:
    support: Support
    evidence: Array  # (n,) of each pixel, for the plane or against it


@dataclass(frozen=True)
class _Seen:
    """Some n pixels: (n,) columns, rows and inverse depths, and (3, n) where they lie."""

    u: Array
    v: Array
    disparity: Array
    points: Array
    area: Array  # (n,) square metres that each stands for
    weight: Array  # (n,) what each counts

    def value(self, candidate: _Candidate) -> float:
        """Return what all pixels together say for a candidate."""
        return float(self.weight @ candidate.evidence)


def find_support(
    xyz: Array, near: Mask, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> Support | None:
    """Return the best of `MAX_PLANES` candidates; None where none is big enough.

    Candidates are drawn in turn from what earlier ones left. The best has most pixels, near ones
    counting more; what is seen beneath a plane's own extent speaks against it, because things
    stand on a table and nothing is seen through it. Planes of a few square centimetres are a
    hand's fingers before the lens: they are no candidates and do not count (D. 106).
    """
    at = np.flatnonzero(near)
    if len(at) < MIN_PIXELS:
        return None
    step = len(at) // FITTED | 1  # odd: rows rarely meet the same columns
    at = rng.permutation(at[::step])
    v, u = (place.astype(np.float64) for place in np.divmod(at, near.shape[1]))
    points = np.ascontiguousarray(xyz.reshape(-1, 3).take(at, axis=0).T)
    disparity = 1.0 / points[2]
    # A few stray pixels at the lens would outweigh a table by their inverse depth (D. 102).
    weight = np.minimum(disparity, quantiles(disparity, 1.0 - STRAY)) ** 2
    area = step * points[2] ** 2 / (intrinsics.fx * intrinsics.fy)  # at least
    seen = _Seen(u, v, disparity, points, area, weight)
    found = _candidates(seen, intrinsics, config, rng)
    best = max(found, key=seen.value, default=None)
    if best is None:
        return None
    # What is nearer than the plane is on it or before it, and counts no more than the plane does.
    most = float(quantiles(weight[best.evidence > 0], 1.0 - STRAY))
    share = seen.value(best) / float(np.minimum(weight, most).sum())
    return best.support if share > config.min_plane_share else None


def _candidates(
    seen: _Seen, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> list[_Candidate]:
    """Return up to `MAX_PLANES` candidates; the `weight` of planes that are too small becomes 0."""
    found: list[_Candidate] = []
    left = np.ones(len(seen.u), np.bool_)
    for _ in range(MAX_PLANES + MAX_FINGERS):
        rest = np.flatnonzero(left)
        best = max(map(seen.value, found), default=0.0)
        if len(rest) < MIN_PIXELS or seen.weight @ left <= best or len(found) == MAX_PLANES:
            break  # none can be better
        drawn = seen.u.take(rest), seen.v.take(rest), seen.disparity.take(rest)
        affine = _ransac(*drawn, config.plane_tolerance, rng)
        if affine is None:  # pixels of one row or column
            break
        residual = seen.disparity - (affine[0] * seen.u + affine[1] * seen.v + affine[2])
        inliers = np.abs(residual) < config.plane_tolerance
        own = inliers & left
        if np.count_nonzero(own) < MIN_PIXELS / 10:
            break
        left &= ~inliers
        if seen.area @ own < config.min_support_area:
            seen.weight[own] = 0.0
            continue
        plane, behind = _plane_of(affine, intrinsics), residual < -2.0 * config.plane_tolerance
        beneath = _seen_through(seen.points, behind, plane, inliers)
        evidence = _facing_weight(plane) * (own - config.beneath_weight * beneath)
        found.append(_Candidate(Support(affine, plane), evidence))
    return found


def _seen_through(points: Array, behind: Mask, plane: Plane, inliers: Mask) -> Mask:
    """Return which of `points` (3, n) that are `behind` the plane are seen through its extent."""
    places = np.flatnonzero(behind)
    crossing = points.take(places, axis=1)
    along = plane.normal @ crossing
    crossing *= -plane.offset / np.where(along < 0, along, -1e-9)
    result = behind.copy()
    extent = points.take(np.flatnonzero(inliers)[:SAMPLE], axis=1)
    result[places] = Footprint.around(extent.T, plane, 0.0).contains(crossing.T)
    return result


def _facing_weight(plane: Plane) -> float:
    # A wall faces the viewer level with the image; a table is seen from above, so its normal
    # leans to the image's top. An overhead or an upside-down camera is rarer, not impossible.
    return 1.0 if plane.normal[1] < 0.3 else 0.6


def _ransac(
    u: Array, v: Array, disparity: Array, tolerance: float, rng: np.random.Generator
) -> Affine | None:
    """Return (a, b, c) of the plane 1/z = a u + b v + c with most pixels within `tolerance`.

    None where no three pixels drawn are corners of a triangle.
    """
    triples = rng.integers(0, len(u), (ITERATIONS, 3))
    matrices = np.stack([u[triples], v[triples], np.ones(triples.shape)], axis=-1)
    sound = np.abs(np.linalg.det(matrices)) > 1.0
    if not sound.any():
        return None
    hypotheses = np.linalg.solve(matrices[sound], disparity[triples][sound][..., None])[..., 0]
    sample = np.stack([u[:SAMPLE], v[:SAMPLE], disparity[:SAMPLE]]).astype(np.float32)
    most = np.argmax(_counts(hypotheses.astype(np.float32), sample, tolerance))
    a, b, c = hypotheses[most].tolist()
    fitted = 0.0
    for _ in range(MAX_FITS):
        # Three unknowns of thousands of pixels: their normal equations are as good, and quick.
        squares, products = _moments(u, v, disparity, (a, b, c), tolerance)
        a, b, c = np.linalg.lstsq(squares, products, rcond=None)[0].tolist()
        if squares[2, 2] == fitted:  # as many pixels: it has settled (D. 102)
            break
        fitted = squares[2, 2]
    return a, b, c


def _plane_of(affine: Affine, intrinsics: Intrinsics) -> Plane:
    """Return the plane, normal toward the camera, of 1/z = a u + b v + c."""
    a, b, c = affine
    # u = fx x/z + cx, so 1 = a fx x + b fy y + (a cx + b cy + c) z.
    n = np.array([a * intrinsics.fx, b * intrinsics.fy, a * intrinsics.cx + b * intrinsics.cy + c])
    length = float(np.linalg.norm(n))
    return Plane(n / length, -1.0 / length).facing(np.zeros(3))


@compiled
def _counts(hypotheses: Singles, sample: Singles, tolerance: float) -> Indices:
    """Return (m,) how many pixels' inverse depths are within `tolerance` of each hypothesis.

    `hypotheses`: (m, 3) a, b and c. `sample`: (3, n) column, row and inverse depth.
    """
    counts, limit = np.zeros(len(hypotheses), np.int64), np.float32(tolerance)
    for m in range(len(hypotheses)):
        a, b, c = hypotheses[m, 0], hypotheses[m, 1], hypotheses[m, 2]
        count = np.int32(0)
        for n in range(sample.shape[1]):
            error = a * sample[0, n] + b * sample[1, n] + c - sample[2, n]
            count += np.int32(abs(error) < limit)
        counts[m] = count
    return counts


@compiled
def _moments(
    u: Array, v: Array, disparity: Array, affine: Affine, tolerance: float
) -> tuple[Array, Array]:
    """Return the normal equations, (3, 3) and (3,), of the pixels within `tolerance` of a plane."""
    a, b, c = affine
    uu, uv, vv, su, sv, n, du, dv, d = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(u)):
        x, y, z = u[k], v[k], disparity[k]
        if abs(a * x + b * y + c - z) < tolerance:
            uu, uv, vv = uu + x * x, uv + x * y, vv + y * y
            su, sv, n = su + x, sv + y, n + 1.0
            du, dv, d = du + x * z, dv + y * z, d + z
    return np.array([[uu, uv, su], [uv, vv, sv], [su, sv, n]]), np.array([du, dv, d])
