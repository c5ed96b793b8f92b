"""What a candidate plane makes of the seen points, point by point: what a plane critic looks at.

Each point is told in the plane's own axes (normal, up in the plane, across), with where its mirror
image falls: on the seen surface or off it, behind what the camera saw or before it, above the
table or beneath. Nothing depends on which way the plane's normal points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.fitting_sums import mirror_images
from pipelines.geometry.numerics.nearest import nearest_of
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.transforms import cross, unit
from pipelines.grasping.candidates.plane_candidates import ENDS
from pipelines.grasping.observation import SceneCloud
from pipelines.tabletop.levelling import UNKNOWN_UP

Array = NDArray[np.float64]
Rows = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Pictured = tuple[Indices, Mask, Array, Mask]

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
        gap: (k, m) metres along that one's normal.
        agreement: (k, m) cosine between that normal and the mirrored one.
        sides: (k, 3) metres from each plane to the ends of the points, along its normal, and
            between them to the median.
    """

    points: Array
    normals: Array
    moved: Indices
    images: Array
    distance: Array
    gap: Array
    agreement: Array
    sides: Array

    @classmethod
    def of(cls, planes: list[ReflectionSymmetry], points: Array, normals: Array) -> "MirrorImages":
        """Return the images of some of `points` (n, 3) in `planes`."""
        moved = np.linspace(0, len(points) - 1, NUM_POINTS).round().astype(np.int64)
        normal = np.array([plane.normal for plane in planes])
        point = np.array([plane.point for plane in planes])
        images = mirror_images(points[moved], normal, point)
        distance, nearest = nearest_of(points, images)
        met = _meetings(images, nearest, points, normals, moved, normal)
        offset = np.einsum("ki,ki->k", normal, point)
        sides = quantiles(normal @ points.T, (ENDS[0], 0.5, ENDS[1])) - offset[:, None]
        return cls(points, normals, moved, images, distance, *met, sides)


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
    mask: Mask,
    scene: SceneCloud,
) -> Rows:
    """Return (k, 128, 14): what each plane makes of some of the points.

    In order: the point (3, decimetres) and its normal (3) in the plane's axes; the image's distance
    to the nearest seen point, its gap along that one's normal, whether the normals agree; how far
    behind the depth image it lies, whether anything was measured there, whether that is the region
    (`mask`, (H, W)); the heights of point and image above the table.
    """
    axes, foot = _plane_axes(planes, mirrored, scene)
    flat, table = mirrored.images.reshape(-1, 3), np.zeros(4)
    if scene.plane is not None:
        table[:3], table[3] = scene.plane.normal, scene.plane.offset
    seen = mirrored.points[mirrored.moved], mirrored.normals[mirrored.moved]
    told = mirrored.images, mirrored.distance, mirrored.gap, mirrored.agreement
    pictured = *scene.intrinsics.pixels_of(flat), scene.depth, mask
    return _rows(axes, foot, seen, told, pictured, table)


def _plane_axes(
    planes: list[ReflectionSymmetry], mirrored: MirrorImages, scene: SceneCloud
) -> tuple[Array, Array]:
    """Return (k, 3, 3) normal, up and across of each plane, and (k, 3) its point near the middle.

    The normal points to the side on which most of the surface is seen.
    """
    middle = mirrored.points.mean(axis=0)
    top = UNKNOWN_UP if scene.plane is None else scene.plane.normal
    normal = np.array([plane.normal for plane in planes])
    at = np.array([plane.point for plane in planes])
    normal = np.where(mirrored.sides[:, 1] >= 0, 1.0, -1.0)[:, None] * normal
    up = top - (normal @ top)[:, None] * normal
    ray = unit(middle)
    level = np.sqrt(np.einsum("ki,ki->k", up, up)) < LEVEL
    up = unit(np.where(level[:, None], ray - (normal @ ray)[:, None] * normal, up))
    foot = middle - np.einsum("ki,ki->k", middle - at, normal)[:, None] * normal
    return np.stack([normal, up, cross(normal, up)], axis=1), foot


@compiled
def _meetings(
    images: Array,
    nearest: Indices,
    points: Array,
    normals: Array,
    moved: Indices,
    planes: Array,
) -> tuple[Array, Array]:
    """Return (k, m) how far images lie from the `nearest` of `points` (n, 3), along its normal.

    And the cosine between that normal and the image's, mirrored in planes with normals (k, 3).
    """
    gap, agreement = np.empty(nearest.shape), np.empty(nearest.shape)
    for k in range(len(images)):
        for m in range(len(moved)):
            met, own = nearest[k, m], moved[m]
            off, alike, here, there = 0.0, 0.0, 0.0, 0.0
            for i in range(3):
                off += normals[met, i] * (images[k, m, i] - points[met, i])
                alike += normals[met, i] * normals[own, i]
                here += normals[own, i] * planes[k, i]
                there += normals[met, i] * planes[k, i]
            gap[k, m], agreement[k, m] = off, alike - 2.0 * here * there
    return gap, agreement


@compiled
def _rows(
    axes: Array,
    foot: Array,
    seen: tuple[Array, Array],
    told: tuple[Array, Array, Array, Array],
    pictured: Pictured,
    table: Array,
) -> Rows:
    """Return what `point_rows` says.

    Args:
        axes: (k, 3, 3) of the planes.
        foot: (k, 3) on them.
        seen: points and normals (m, 3).
        told: of their images (k, m, 3) the distance, the gap and the agreement (k, m).
        pictured: the images' pixels (k m, 2), which lie in the picture, its depth (H, W) and mask.
        table: (4,) normal and offset; zeros for none.
    """
    (points, normals), (images, distance, gap, agreement) = seen, told
    pixels, inside, depth, mask = pictured
    rows = np.zeros((len(axes), len(points), POINT_FEATURES), np.float32)
    for k in range(len(axes)):
        for m in range(len(points)):
            height, image_height = table[3], table[3]
            for a in range(3):
                along, facing = 0.0, 0.0
                for i in range(3):
                    along += axes[k, a, i] * (points[m, i] - foot[k, i])
                    facing += axes[k, a, i] * normals[m, i]
                rows[k, m, a], rows[k, m, 3 + a] = 10.0 * along, facing
                height += table[a] * points[m, a]
                image_height += table[a] * images[k, m, a]
            rows[k, m, 6] = min(distance[k, m], FARTHEST) / FARTHEST * 0.9
            rows[k, m, 7] = min(max(gap[k, m], -0.02), 0.02) * 50.0
            rows[k, m, 8] = agreement[k, m]
            at = k * len(points) + m
            if inside[at]:
                column, row = pixels[at, 0], pixels[at, 1]
                if depth[row, column] > 0:
                    behind = images[k, m, 2] - depth[row, column]
                    rows[k, m, 9] = 20.0 * min(max(behind, -DEEPEST), DEEPEST)
                    rows[k, m, 10] = 1.0
                rows[k, m, 11] = mask[row, column]
            rows[k, m, 12] = 5.0 * min(max(height, HEIGHTS[0]), HEIGHTS[1])
            rows[k, m, 13] = 5.0 * min(max(image_height, HEIGHTS[0]), HEIGHTS[1])
    return rows
