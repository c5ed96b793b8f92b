"""Where the symmetric regions of posed objects are in an image (Sec. III-D).

The instance label says which pixels show an object; rays against its posed mesh say which of its
triangles, and so which of its regions, each of these pixels shows. So masks are visible parts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array, Mask
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.rendering import first_hits
from pipelines.geometry.symmetry import Symmetry
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points

NUM_VISIBILITY_SAMPLES = 500


@dataclass(frozen=True)
class ObjectRegion:
    """A region of an object: its triangles (k,) and symmetries, object frame."""

    name: str
    triangles: NDArray[np.int64]
    symmetries: tuple[Symmetry, ...]


@dataclass(frozen=True)
class RegionedObject:
    """An object's mesh and its symmetric regions, object frame, metres."""

    mesh: Mesh
    regions: tuple[ObjectRegion, ...]

    @property
    def region_of_triangle(self) -> NDArray[np.int64]:
        """(f,) the index of each triangle's region; -1 for triangles of no region."""
        owner = np.full(len(self.mesh.faces), -1, dtype=np.int64)
        for index, region in enumerate(self.regions):
            owner[region.triangles] = index
        return owner


@dataclass(frozen=True)
class RegionInstance:
    """One region of one object as a frame shows it.

    Attributes:
        object_id: of the dataset.
        name: of the region.
        mask: (H, W) the pixels that show it.
        visible: share of the region's surface toward the camera that the mask holds, 0 to 1.
        symmetries: camera frame, metres.
    """

    object_id: int
    name: str
    mask: Mask
    visible: float
    symmetries: tuple[Symmetry, ...]


def visible_regions(
    label: NDArray[np.integer],
    intrinsics: Intrinsics,
    poses: Sequence[tuple[int, ArrayLike]],
    objects: Mapping[int, RegionedObject],
) -> list[RegionInstance]:
    """Return every region that shows in at least one pixel, in the order of `poses`.

    Args:
        label: (H, W) object id + 1, 0 = background, as GraspNet has it.
        intrinsics: of the label image.
        poses: (object id, T_cam_obj (4, 4)) of each object of the scene.
        objects: by object id; objects that are not here have no regions.
    """
    instances = []
    for object_id, pose in poses:
        if object_id not in objects:
            continue
        T_cam_obj = np.asarray(pose, np.float64)
        shown = label == object_id + 1
        instances += _object_instances(object_id, objects[object_id], shown, intrinsics, T_cam_obj)
    return instances


def _object_instances(
    object_id: int, posed: RegionedObject, shown: Mask, intrinsics: Intrinsics, T_cam_obj: Array
) -> list[RegionInstance]:
    owner = _region_image(posed, shown, intrinsics, T_cam_obj)
    instances = []
    for index, region in enumerate(posed.regions):
        mask = owner == index
        if not mask.any():
            continue
        symmetries = tuple(symmetry.transformed(T_cam_obj) for symmetry in region.symmetries)
        visible = _visible_share(posed.mesh, region, mask, intrinsics, T_cam_obj)
        instances.append(RegionInstance(object_id, region.name, mask, visible, symmetries))
    return instances


def _region_image(
    posed: RegionedObject, shown: Mask, intrinsics: Intrinsics, T_cam_obj: Array
) -> NDArray[np.int64]:
    """Return (H, W) the index of the region that each pixel of `shown` shows; -1 elsewhere."""
    image = np.full(shown.shape, -1, dtype=np.int64)
    only_whole = len(posed.regions) == 1 and len(posed.regions[0].triangles) == len(
        posed.mesh.faces
    )
    if only_whole or not shown.any():
        image[shown] = 0
        return image
    T_obj_cam = invert(T_cam_obj)
    v, u = np.nonzero(shown)
    rays = np.stack(
        [(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(len(u))],
        axis=1,
    )
    origins = np.broadcast_to(T_obj_cam[:3, 3], rays.shape)
    triangle = first_hits(posed.mesh, origins, rotate_vectors(T_obj_cam, rays))[1]
    # Labels and poses agree to a pixel or so: a ray of the outline that misses shows no region.
    image[v, u] = np.where(triangle >= 0, posed.region_of_triangle[triangle], -1)
    return image


def _visible_share(
    mesh: Mesh, region: ObjectRegion, mask: Mask, intrinsics: Intrinsics, T_cam_obj: Array
) -> float:
    """Return which share of the samples that face the camera project into `mask`."""
    part = mesh.submesh(region.triangles)
    points, normals, _ = sample_surface(part, NUM_VISIBILITY_SAMPLES, np.random.default_rng(0))
    points, normals = transform_points(T_cam_obj, points), rotate_vectors(T_cam_obj, normals)
    facing = np.einsum("ni,ni->n", points, normals) < 0.0
    facing &= points[:, 2] > 0.0
    if not facing.any():
        return 0.0
    pixels, inside = intrinsics.pixels_of(points[facing])
    u, v = pixels[inside].T
    held = mask[v, u].sum()
    return float(held / facing.sum())
