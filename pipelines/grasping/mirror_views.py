"""What a candidate plane makes of the seen points, point by point: what a plane judge looks at.

Each point is told in the plane's own axes (normal, up in the plane, across), with where its mirror
image falls: on the seen surface or off it, behind what the camera saw or before it, above the
table or beneath. Nothing depends on which way the plane's normal points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.levelling import UNKNOWN_UP
from pipelines.geometry.nearest import nearest_of
from pipelines.geometry.quantiles import median
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.symmetry_fitting import mirrored
from pipelines.geometry.transforms import cross, unit
from pipelines.grasping.observation import SceneCloud

Array = NDArray[np.float64]
Rows = NDArray[np.float32]

NUM_POINTS = 128  # of a region that are mirrored
FARTHEST = 0.03  # metres from an image to the seen surface; beyond, it is far
DEEPEST = 0.05  # metres behind or before what is seen
HEIGHTS = (-0.1, 0.5)  # metres above the table
LEVEL = 0.3  # of a plane this level, up says nothing: forward takes its place
POINT_FEATURES = 14
PLANE_FEATURES = 3


@dataclass(frozen=True)
class MirrorImages:
    """Points of a region, and the images of m of them in each of k planes.

    Attributes:
        points: (n, 3) metres, camera frame.
        normals: (n, 3).
        moved: (m,) which points are mirrored, evenly taken; some twice where there are fewer.
        images: (k, m, 3).
        distance: (k, m) metres from an image to the nearest seen point of the region.
        nearest: (k, m) that point's index.
    """

    points: Array
    normals: Array
    moved: NDArray[np.int64]
    images: Array
    distance: Array
    nearest: NDArray[np.intp]

    @classmethod
    def of(cls, planes: list[ReflectionSymmetry], points: Array, normals: Array) -> "MirrorImages":
        """Return the images of some of `points` (n, 3) in `planes`."""
        moved = np.linspace(0, len(points) - 1, NUM_POINTS).round().astype(np.int64)
        normal = np.array([plane.normal for plane in planes])
        point = np.array([plane.point for plane in planes])
        images = mirrored(points[moved], normal, point)
        return cls(points, normals, moved, images, *nearest_of(points, images))


def plane_rows(planes: list[ReflectionSymmetry], region: Array, scene: SceneCloud) -> Rows:
    """Return (k, 3): how each plane stands to the table and the view.

    `region`: its points (n, 3), metres, camera frame.
    """
    ray = unit(region.mean(axis=0))
    up = np.zeros(3) if scene.plane is None else scene.plane.normal
    normal = np.array([plane.normal for plane in planes])
    columns = [np.abs(normal @ up), np.abs(normal @ ray), np.full(len(planes), ray @ up)]
    return np.stack(columns, axis=1).astype(np.float32)


def point_rows(
    planes: list[ReflectionSymmetry],
    mirrored: MirrorImages,
    mask: NDArray[np.bool_],
    scene: SceneCloud,
) -> Rows:
    """Return (k, 128, 14): what each plane makes of some of the points.

    In order: the point (3, decimetres) and its normal (3) in the plane's axes; the image's distance
    to the nearest seen point, its gap along that one's normal, whether the normals agree; how far
    behind the depth image it lies, whether anything was measured there, whether that is the region
    (`mask`, (H, W)); the heights of point and image above the table.
    """
    points, normals = mirrored.points[mirrored.moved], mirrored.normals[mirrored.moved]
    axes, foot = _plane_axes(planes, mirrored.points, scene)
    images, nearest = mirrored.images, mirrored.nearest
    beside = mirrored.normals[nearest]
    normal = axes[:, 0]
    turned = normals - 2.0 * (normals @ normal.T).T[..., None] * normal[:, None]
    gap = np.einsum("kni,kni->kn", beside, images - mirrored.points[nearest])
    own = np.einsum("kai,kni->kna", axes, points - foot[:, None])
    columns = [
        10.0 * own,
        np.einsum("kai,ni->kna", axes, normals),
        np.minimum(mirrored.distance, FARTHEST)[..., None] / FARTHEST * 0.9,
        np.clip(gap, -0.02, 0.02)[..., None] * 50.0,
        np.einsum("kni,kni->kn", beside, turned)[..., None],
        _against_depth(images, mask, scene),
        _heights(np.broadcast_to(points, images.shape), scene),
        _heights(images, scene),
    ]
    return np.concatenate(columns, axis=-1).astype(np.float32)


def _plane_axes(
    planes: list[ReflectionSymmetry], points: Array, scene: SceneCloud
) -> tuple[Array, Array]:
    """Return (k, 3, 3) normal, up and across of each plane, and (k, 3) its point near the middle.

    The normal points to the side on which most of the surface is seen.
    """
    middle, top = points.mean(axis=0), UNKNOWN_UP if scene.plane is None else scene.plane.normal
    normal = np.array([plane.normal for plane in planes])
    at = np.array([plane.point for plane in planes])
    offset = np.einsum("ki,ki->k", normal, at)
    seen = median(normal @ points.T) - offset
    normal = np.where(seen >= 0, 1.0, -1.0)[:, None] * normal
    up = top - (normal @ top)[:, None] * normal
    ray = unit(middle)
    level = np.linalg.norm(up, axis=1) < LEVEL
    up = unit(np.where(level[:, None], ray - (normal @ ray)[:, None] * normal, up))
    foot = middle - np.einsum("ki,ki->k", middle - at, normal)[:, None] * normal
    return np.stack([normal, up, cross(normal, up)], axis=1), foot


def _against_depth(images: Array, mask: NDArray[np.bool_], scene: SceneCloud) -> Array:
    """Return (k, n, 3): how far behind the depth image, whether measured, whether the region."""
    flat = images.reshape(-1, 3)
    height, width = scene.depth.shape
    pixels, inside = scene.intrinsics.pixels_of(flat)
    column, row = np.clip(pixels, 0, (width - 1, height - 1)).T
    seen = np.where(inside, scene.depth[row, column], 0.0)
    behind = np.where(seen > 0, np.clip(flat[:, 2] - seen, -DEEPEST, DEEPEST), 0.0)
    rows = np.stack([20.0 * behind, seen > 0, inside & mask[row, column]], axis=-1)
    return rows.reshape(*images.shape[:2], 3)


def _heights(points: Array, scene: SceneCloud) -> Array:
    """Return (k, n, 1), zeros where no table is known."""
    if scene.plane is None:
        return np.zeros((*points.shape[:2], 1))
    return 5.0 * np.clip(scene.plane.height(points), *HEIGHTS)[..., None]
