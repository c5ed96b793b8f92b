"""Features of mirror planes for the critics: seen points and their mirror images.

Each point is given in the plane's axes (normal, up in the plane, across), with the position of its
mirror image: on or off the seen surface, behind or in front of the measured surface, above or
beneath the table. The features do not depend on the sign of the plane's normal.
"""

from dataclasses import dataclass
from enum import IntEnum, auto

import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.fitting_sums import mirror_images
from pipelines.geometry.numerics.nearest import Neighbors
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.transforms import cross, unit
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.region_shape import ENDS

Projected = tuple[Indices, Mask, Array, Mask]

# All chosen by eye; the shipped weights were trained with these values.
NUM_POINTS = 128  # mirrored points of a region
FARTHEST = 0.03  # metres, cap of the distance from an image to the seen surface
FARTHEST_GAP = 0.02  # metres, cap of this distance along the normal
DEEPEST = 0.05  # metres, cap of the depth behind or in front of the measured surface
HEIGHTS = (-0.1, 0.5)  # metres above the table, caps
# Per metre, or of a cap: they bring the features near one.
LENGTH_SCALE, HEIGHT_SCALE, BEHIND_SCALE, GAP_SCALE = 10.0, 5.0, 20.0, 50.0
AT_FARTHEST = 0.9  # feature of an image at `FARTHEST` or beyond
FLAT = 0.001  # metres, least extent of the points that `off_middle` is relative to
LEVEL = 0.3  # length of up in the plane below which the viewing direction replaces it


class PlanePointFeature(IntEnum):
    """Columns of the features of a point and its mirror image."""

    ALONG_NORMAL = 0  # decimetres, as the next two
    ALONG_UP = auto()
    ALONG_ACROSS = auto()
    NORMAL_NORMAL = auto()  # the surface normal in the plane's axes
    NORMAL_UP = auto()
    NORMAL_ACROSS = auto()
    IMAGE_DISTANCE = auto()  # to the nearest seen point of the region; 0.9 at `FARTHEST`
    IMAGE_GAP = auto()  # same along that point's normal, in `FARTHEST_GAP`
    IMAGE_AGREEMENT = auto()  # cosine of that normal and the mirrored normal
    IMAGE_BEHIND = auto()  # the depth measured at its pixel, half decimetres
    IMAGE_IS_MEASURED = auto()  # whether its pixel has a measurement
    IMAGE_IS_OWN = auto()  # whether its pixel is in the region
    HEIGHT = auto()  # above the table, 2 decimetres
    IMAGE_HEIGHT = auto()


POINT_FEATURES = tuple(each.name.lower() for each in PlanePointFeature)
POINT_COLUMNS = len(PlanePointFeature)
# Cosines between the plane's normal and up, the normal and the view, the view and up.
PLANE_FEATURES = ("normal_up", "normal_view", "view_up")


@dataclass(frozen=True)
class MirrorImages:
    """Points of a region, and images of m points in each of k planes. Camera frame, metres.

    Attributes:
        points: (n, 3).
        normals: (n, 3) unit.
        moved: (m,) indices of the mirrored points, evenly chosen; few points are repeated.
        images: (k, m, 3).
        distance: (k, m) from an image to the nearest seen point of the region.
        gap: (k, m) the same distance along that point's normal.
        agreement: (k, m) cosine of that normal and the mirrored normal.
        sides: (k, 3) distances from each plane, along its normal, to the lower end of the points,
            to their median and to their upper end.
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
        distance, nearest = Neighbors.of(points).nearest(images)
        met = _meetings(images, nearest, points, normals, moved, normal)
        offset = np.einsum("ki,ki->k", normal, point)
        sides = quantiles(normal @ points.T, (ENDS[0], 0.5, ENDS[1])) - offset[:, None]
        return cls(points, normals, moved, images, distance, *met, sides)

    @property
    def off_middle(self) -> Array:
        """Distances (k,) of the planes to the middle of the points, in half extents, up to 1."""
        low, _, high = self.sides.T
        return np.asarray(np.minimum(np.abs(low + high) / np.maximum(high - low, FLAT), 1.0))

    def features(self, frames: Array, foot: Array, mask: Mask, scene: SceneCloud) -> Singles:
        """Return the `POINT_FEATURES` (k, m, 14) of points under each plane.

        Args:
            frames: (k, 3, 3) normal, up and across of each plane.
            foot: (k, 3) origins of the frames, on the planes.
            mask: (H, W) the region's pixels.
            scene: measured depth and table.
        """
        flat, table = self.images.reshape(-1, 3), np.zeros(4)
        if scene.plane is not None:
            table[:3], table[3] = scene.plane.normal, scene.plane.offset
        seen = self.points[self.moved], self.normals[self.moved]
        met = self.images, self.distance, self.gap, self.agreement
        projected = *scene.intrinsics.pixels_of(flat), scene.depth, mask
        return _rows(frames, foot, seen, met, projected, table)


def plane_features(planes: list[ReflectionSymmetry], region: Array, scene: SceneCloud) -> Singles:
    """Return the `PLANE_FEATURES` (k, 3) of planes of a region with points (n, 3)."""
    ray = unit(region.mean(axis=0))
    up = np.zeros(3) if scene.plane is None else scene.plane.normal
    normal = np.array([plane.normal for plane in planes])
    columns = [np.abs(normal @ up), np.abs(normal @ ray), np.full(len(planes), ray @ up)]
    return np.stack(columns, axis=1).astype(np.float32)


def point_features(
    planes: list[ReflectionSymmetry], mirrored: MirrorImages, mask: Mask, scene: SceneCloud
) -> Singles:
    """Return the `POINT_FEATURES` (k, 128, 14) of points under each plane.

    `mask`: (H, W) the region's pixels.
    """
    return mirrored.features(*_plane_axes(planes, mirrored, scene), mask, scene)


def _plane_axes(
    planes: list[ReflectionSymmetry], mirrored: MirrorImages, scene: SceneCloud
) -> tuple[Array, Array]:
    """Return normal, up and across (k, 3, 3) of each plane, and its point (k, 3) near the middle.

    The normal points to the side with most of the seen surface.
    """
    middle = mirrored.points.mean(axis=0)
    normal = np.array([plane.normal for plane in planes])
    at = np.array([plane.point for plane in planes])
    normal = np.where(mirrored.sides[:, 1] >= 0, 1.0, -1.0)[:, None] * normal
    up = scene.up - (normal @ scene.up)[:, None] * normal
    ray = unit(middle)
    level = np.sqrt(np.einsum("ki,ki->k", up, up)) < LEVEL
    up = unit(np.where(level[:, None], ray - (normal @ ray)[:, None] * normal, up))
    foot = middle - np.einsum("ki,ki->k", middle - at, normal)[:, None] * normal
    return np.stack([normal, up, cross(normal, up)], axis=1), foot


@compiled
def _meetings(
    images: Array, nearest: Indices, points: Array, normals: Array, moved: Indices, planes: Array
) -> tuple[Array, Array]:
    """Return distances (k, m) of images from the `nearest` of `points` (n, 3), along its normal.

    Also the cosines of this normal and the image's normal; `planes` (k, 3): normals of the planes.
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
    met: tuple[Array, Array, Array, Array],
    projected: Projected,
    table: Array,
) -> Singles:
    """Return the result of `MirrorImages.features`.

    Args:
        axes: (k, 3, 3) axes of the planes.
        foot: (k, 3) points on the planes.
        seen: points and normals (m, 3).
        met: images (k, m, 3), their distance, gap and agreement (k, m).
        projected: pixels (k m, 2) of the images, which are inside, depth (H, W), mask.
        table: (4,) normal and offset; zeros without a table.
    """
    (points, normals), (images, distance, gap, agreement) = seen, met
    pixels, inside, depth, mask = projected
    rows = np.zeros((len(axes), len(points), POINT_COLUMNS), np.float32)
    for k in range(len(axes)):
        for m in range(len(points)):
            height, image_height = table[3], table[3]
            for a in range(3):
                along, facing = 0.0, 0.0
                for i in range(3):
                    along += axes[k, a, i] * (points[m, i] - foot[k, i])
                    facing += axes[k, a, i] * normals[m, i]
                rows[k, m, PlanePointFeature.ALONG_NORMAL + a] = LENGTH_SCALE * along
                rows[k, m, PlanePointFeature.NORMAL_NORMAL + a] = facing
                height += table[a] * points[m, a]
                image_height += table[a] * images[k, m, a]
            far = min(distance[k, m], FARTHEST) / FARTHEST * AT_FARTHEST
            off = min(max(gap[k, m], -FARTHEST_GAP), FARTHEST_GAP)
            rows[k, m, PlanePointFeature.IMAGE_DISTANCE] = far
            rows[k, m, PlanePointFeature.IMAGE_GAP] = off * GAP_SCALE
            rows[k, m, PlanePointFeature.IMAGE_AGREEMENT] = agreement[k, m]
            at = k * len(points) + m
            if inside[at]:
                column, row = pixels[at, 0], pixels[at, 1]
                if depth[row, column] > 0:
                    behind = min(max(images[k, m, 2] - depth[row, column], -DEEPEST), DEEPEST)
                    rows[k, m, PlanePointFeature.IMAGE_BEHIND] = BEHIND_SCALE * behind
                    rows[k, m, PlanePointFeature.IMAGE_IS_MEASURED] = 1.0
                rows[k, m, PlanePointFeature.IMAGE_IS_OWN] = mask[row, column]
            height = min(max(height, HEIGHTS[0]), HEIGHTS[1])
            image_height = min(max(image_height, HEIGHTS[0]), HEIGHTS[1])
            rows[k, m, PlanePointFeature.HEIGHT] = HEIGHT_SCALE * height
            rows[k, m, PlanePointFeature.IMAGE_HEIGHT] = HEIGHT_SCALE * image_height
    return rows
