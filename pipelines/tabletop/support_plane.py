"""The support plane of a frame, fitted in inverse depth.

A plane is affine in inverse depth: 1/z = a u + b v + c. Stereo and structured light have nearly
constant noise there, so planes are fitted and compared in inverse depth, and a tolerance of `t`
metres at one metre means t z^2 metres at depth z.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.footprint import Footprint

Affine = tuple[float, float, float]  # a, b and c of 1/z = a u + b v + c

MAX_PLANES = 4  # candidates, found one after the other
MAX_SMALL_PLANES = 4  # planes found in between that are too small for a table
ITERATIONS = 300  # hypotheses per candidate
FITTED = 20000  # pixels, about, to which planes are fitted, evenly spread
CONSENSUS_SAMPLE = 4000  # of these pixels, on which hypotheses are compared
MIN_PIXELS = 200  # fewer pixels determine no plane
MIN_OWN = 20  # least pixels of a candidate that no earlier candidate has
MIN_TRIANGLE = 1.0  # pixels^2, twice the area of three pixels that are not collinear
MAX_FITS = 20  # least-squares fits of a plane to its inliers, until these stay the same
SIDE = np.cos(np.deg2rad(15.0))  # of the angle beyond which a plane may be the side of a bin
CELL = 8  # pixels of a cell for testing a floor's surroundings
LARGE_PART = 0.1  # of a plane's largest part: area from which a part is large
ENCLOSED = 0.9  # share of a floor's surroundings that are nearer than its plane
CLOSEST_SHARE = 0.05  # the nearest pixels weigh no more than the pixel at this quantile
COVERED, ALMOST_ALL = 0.5, 0.8  # shares of a cell's pixels
LEANS_DOWN = 0.3  # y of a unit normal from which it leans to the image's bottom, as a wall's
MIN_DESCENT = 1e-9  # metres toward the plane, of a ray that would never meet it
WALL_WEIGHT = 0.6  # of the pixels of a plane that may be a wall
# Closes gaps between parts of a table that only shadows separate.
SHADOW_GAPS = np.ones((9, 9), np.uint8)


@dataclass(frozen=True)
class Support:
    """A plane in inverse depth and in space, camera frame."""

    affine: Affine
    plane: Plane


@dataclass(frozen=True)
class _Candidate:
    support: Support
    evidence: Array  # (n,) of each pixel: positive for the plane, negative against it


@dataclass(frozen=True)
class _PixelSample:
    """A sample of n pixels."""

    u: Array  # (n,) columns
    v: Array  # (n,) rows
    disparity: Array  # (n,) inverse depths
    points: Array  # (3, n) metres, camera frame
    area: Array  # (n,) square metres that a pixel represents
    weight: Array  # (n,)

    def beyond(self, affine: Affine) -> Array:
        """Return inverse depths (n,) minus the plane's: positive for pixels nearer than it."""
        a, b, c = affine
        return self.disparity - (a * self.u + b * self.v + c)

    def value(self, candidate: _Candidate) -> float:
        """Return the weighted evidence of all pixels for a candidate."""
        return float(self.weight @ candidate.evidence)

    @cached_property
    def cells(self) -> tuple[Indices, Indices]:
        """The cell (n,) of each pixel, and the number (r, c) of pixels of each cell."""
        rows, columns = (np.asarray(axis, np.int64) // CELL + 2 for axis in (self.v, self.u))
        shape = int(rows.max()) + 3, int(columns.max()) + 3
        places = rows * shape[1] + columns
        return places, np.bincount(places, minlength=shape[0] * shape[1]).reshape(shape)

    def covered(self, mask: Mask, share: float) -> NDArray[np.uint8]:
        """Return the cells (r, c) of which more than a `share` of the pixels is in `mask` (n,)."""
        places, counts = self.cells
        own = np.bincount(places[mask], minlength=counts.size).reshape(counts.shape)
        return (own > share * counts).view(np.uint8)


def find_support(
    xyz: Array, near: Mask, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> Support | None:
    """Return the best of up to `MAX_PLANES` candidates; None if none is large enough.

    Each candidate is found among the pixels that earlier candidates left. The best candidate has
    most pixels, near pixels weighing more; pixels seen through its extent count against it, because
    a table is opaque. Planes of a few square centimetres are fingers in front of the lens: they are
    no candidates and have no weight (D. 106). `xyz`: (H, W, 3) metres, camera frame. `near`: (H, W)
    pixels to use.
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
    weight = np.minimum(disparity, quantiles(disparity, 1.0 - CLOSEST_SHARE)) ** 2
    area = step * points[2] ** 2 / (intrinsics.fx * intrinsics.fy)  # of a surface facing the camera
    pixels = _PixelSample(u, v, disparity, points, area, weight)
    found = _candidates(pixels, intrinsics, config, rng)
    best = max(found, key=pixels.value, default=None)
    if best is None:
        return None
    # More of a bin's side than of its floor may be visible (D. 129).
    best = max(
        (each for each in found if _is_floor(each, best, pixels)), key=pixels.value, default=best
    )
    # Pixels nearer than the plane weigh no more than pixels of the plane.
    most = float(quantiles(weight[best.evidence > 0], 1.0 - CLOSEST_SHARE))
    share = pixels.value(best) / float(np.minimum(weight, most).sum())
    return best.support if share > config.min_plane_share else None


def _candidates(
    pixels: _PixelSample, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> list[_Candidate]:
    """Return up to `MAX_PLANES` candidates; set the `weight` of pixels of small planes to 0."""
    found: list[_Candidate] = []
    left = np.ones(len(pixels.u), np.bool_)
    for _ in range(MAX_PLANES + MAX_SMALL_PLANES):
        rest = np.flatnonzero(left)
        best = max(map(pixels.value, found), default=0.0)
        if len(rest) < MIN_PIXELS or pixels.weight @ left <= best or len(found) == MAX_PLANES:
            break  # no further plane can be better
        u, v, disparity = (each.take(rest) for each in (pixels.u, pixels.v, pixels.disparity))
        affine = _ransac(u, v, disparity, config.plane_tolerance, rng)
        if affine is None:  # all pixels lie on one line
            break
        residual = pixels.beyond(affine)
        inliers = np.abs(residual) < config.plane_tolerance
        own = inliers & left
        if np.count_nonzero(own) < MIN_OWN:
            break
        left &= ~inliers
        if pixels.area @ own < config.min_support_area:
            pixels.weight[own] = 0.0
            continue
        plane, behind = _plane_of(affine, intrinsics), residual < -2.0 * config.plane_tolerance
        beneath = _seen_through(pixels.points, behind, plane, _in_large_parts(pixels, inliers))
        # For a camera that looks down, a table's normal leans to the image's top (negative y), a
        # wall's to its bottom. Cameras upside down are possible, so the latter only weigh less.
        facing = 1.0 if plane.normal[1] < LEANS_DOWN else WALL_WEIGHT
        evidence = facing * (own - config.beneath_weight * beneath)
        found.append(_Candidate(Support(affine, plane), evidence))
    return found


def _is_floor(candidate: _Candidate, best: _Candidate, pixels: _PixelSample) -> bool:
    """Return whether `candidate` is the floor of a bin of which `best` is a side.

    A floor is at more than 15 degrees to that side and almost entirely surrounded by nearer
    surfaces. Its outline does not touch the image border.
    """
    if abs(candidate.support.plane.normal @ best.support.plane.normal) > SIDE:
        return False
    cells = pixels.covered(candidate.evidence > 0, COVERED)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(cells, connectivity=4)
    if count < 2:
        return False
    largest = labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
    outline = np.zeros_like(cells)
    corners = np.argwhere(largest)[:, ::-1].astype(np.int32)
    cv2.fillConvexPoly(outline, cv2.convexHull(np.ascontiguousarray(corners)), 1)
    near, wide = (cv2.dilate(outline, np.ones((n, n), np.uint8)) > 0 for n in (3, 5))
    around = wide & ~near
    nearer = pixels.covered(pixels.beyond(candidate.support.affine) > 0.0, ALMOST_ALL)
    return bool(np.count_nonzero(nearer[around]) > ENCLOSED * around.sum())


def _in_large_parts(pixels: _PixelSample, inliers: Mask) -> Mask:
    """Return the `inliers` (n,) in large parts of the image (D. 141).

    A cable next to a tray, as high as the tray, is no part of the tray's extent.
    """
    return inliers & large_parts(pixels.covered(inliers, COVERED)).ravel().take(pixels.cells[0])


def large_parts(image: NDArray[np.uint8]) -> Mask:
    """Return the set pixels (H, W) of `image` in parts not much smaller than the largest."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    area = np.asarray(stats, np.int32)[:, cv2.CC_STAT_AREA]
    area[0] = 0  # the background
    return np.asarray((area > LARGE_PART * area.max()).take(labels))


def _seen_through(points: Array, behind: Mask, plane: Plane, inliers: Mask) -> Mask:
    """Return a mask (n,) of `points` (3, n) `behind` the plane that are seen through its extent."""
    places = np.flatnonzero(behind)
    crossing = points.take(places, axis=1)
    along = plane.normal @ crossing
    crossing *= -plane.offset / np.where(along < 0, along, -MIN_DESCENT)
    result = behind.copy()
    extent = points.take(np.flatnonzero(inliers)[:CONSENSUS_SAMPLE], axis=1)
    result[places] = Footprint.around(extent.T, plane, 0.0).contains(crossing.T)
    return result


def _ransac(
    u: Array, v: Array, disparity: Array, tolerance: float, rng: np.random.Generator
) -> Affine | None:
    """Return (a, b, c) of the plane 1/z = a u + b v + c with most pixels within `tolerance`.

    None if every drawn triple of pixels is collinear.
    """
    triples = rng.integers(0, len(u), (ITERATIONS, 3))
    matrices = np.stack([u[triples], v[triples], np.ones(triples.shape)], axis=-1)
    sound = np.abs(np.linalg.det(matrices)) > MIN_TRIANGLE
    if not sound.any():
        return None
    hypotheses = np.linalg.solve(matrices[sound], disparity[triples][sound][..., None])[..., 0]
    sample = np.stack([u, v, disparity])[:, :CONSENSUS_SAMPLE].astype(np.float32)
    most = np.argmax(_counts(hypotheses.astype(np.float32), sample, tolerance))
    a, b, c = hypotheses[most].tolist()
    fitted = 0.0
    for _ in range(MAX_FITS):
        # Normal equations: accurate enough for three unknowns, and fast for thousands of pixels.
        squares, products = _moments(u, v, disparity, (a, b, c), tolerance)
        a, b, c = np.linalg.lstsq(squares, products, rcond=None)[0].tolist()
        if squares[2, 2] == fitted:  # the same number of inliers: converged (D. 102)
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
    """Return the number (m,) of pixels within `tolerance` of each hypothesis, in inverse depth.

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
    """Return the normal equations (3, 3) and (3,) of the pixels within `tolerance` of a plane."""
    a, b, c = affine
    uu, uv, vv, su, sv, n, du, dv, d = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(u)):
        x, y, z = u[k], v[k], disparity[k]
        if abs(a * x + b * y + c - z) < tolerance:
            uu, uv, vv = uu + x * x, uv + x * y, vv + y * y
            su, sv, n = su + x, sv + y, n + 1.0
            du, dv, d = du + x * z, dv + y * z, d + z
    return np.array([[uu, uv, su], [uv, vv, sv], [su, sv, n]]), np.array([du, dv, d])
