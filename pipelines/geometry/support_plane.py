"""The plane that things stand on, fitted in inverse depth to the pixels of a frame.

A plane is affine in inverse depth: 1/z = a u + b v + c. Stereo and structured light measure with
nearly constant noise there, so planes are fitted and judged in inverse depth, and a tolerance of
`t` metres at one metre means t z^2 metres at depth z.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.compiled import compiled
from pipelines.geometry.footprint import Footprint
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.quantiles import quantiles

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Affine = tuple[float, float, float]  # a, b and c of 1/z = a u + b v + c

MAX_PLANES = 4  # candidates that are drawn one after the other
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


def find_support(
    xyz: Array, near: Mask, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> Support | None:
    """Return the best of `MAX_PLANES` candidates; None where none is big enough.

    Candidates are drawn in turn from what earlier ones left. The best has most pixels, near ones
    counting more; what is seen beneath a plane's own extent speaks against it, because things
    stand on a table and nothing is seen through it.
    """
    at = np.flatnonzero(near)
    if len(at) < MIN_PIXELS:
        return None
    at = rng.permutation(at[:: len(at) // FITTED | 1])  # odd: rows rarely meet the same columns
    v, u = (place.astype(np.float64) for place in np.divmod(at, near.shape[1]))
    points = np.ascontiguousarray(xyz.reshape(-1, 3).take(at, axis=0).T)
    disparity = 1.0 / points[2]
    # A few stray pixels at the lens would outweigh a table by their inverse depth (D. 102).
    close = np.minimum(disparity, quantiles(disparity, 1.0 - STRAY))
    weight = close**2 / (close**2).sum()
    best, best_value, left = None, config.min_plane_share, np.ones(len(u), bool)
    for _ in range(MAX_PLANES):
        rest = np.flatnonzero(left)
        if len(rest) < MIN_PIXELS or weight @ left <= best_value:  # none can be better
            break
        drawn = u.take(rest), v.take(rest), disparity.take(rest)
        affine = _ransac(*drawn, config.plane_tolerance, rng)
        residual = disparity - (affine[0] * u + affine[1] * v + affine[2])
        inliers = np.abs(residual) < config.plane_tolerance
        if np.count_nonzero(inliers & left) < MIN_PIXELS / 10:
            break
        plane = _plane_of(affine, intrinsics)
        beneath = _seen_through(points, residual < -2.0 * config.plane_tolerance, plane, inliers)
        value = weight @ (inliers & left) - config.beneath_weight * (weight @ beneath)
        value *= _facing_weight(plane)
        if value > best_value:
            best, best_value = Support(affine, plane), value
        left &= ~inliers
    return best


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
) -> Affine:
    """Return (a, b, c) of the plane 1/z = a u + b v + c with most pixels within `tolerance`."""
    triples = rng.integers(0, len(u), (ITERATIONS, 3))
    matrices = np.stack([u[triples], v[triples], np.ones(triples.shape)], axis=-1)
    sound = np.abs(np.linalg.det(matrices)) > 1.0
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
