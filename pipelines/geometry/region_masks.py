"""Masks of the symmetric regions of posed objects in an image (Sec. III-D).

The instance label gives the pixels of an object; rays against the posed mesh give the triangle, and
so the region, at each of these pixels. The masks contain visible parts only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.rendering import first_hits
from pipelines.geometry.symmetry import ObjectRegion, Symmetry
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points

NUM_VISIBILITY_SAMPLES = 500
UNHIDDEN = 1e-4  # of the distance to the camera, by which a ray may end early: rounding


@dataclass(frozen=True)
class RegionedObject:
    """An object's mesh and its symmetric regions, object frame, metres."""

    mesh: Mesh
    regions: tuple[ObjectRegion, ...]

    @property
    def region_of_triangle(self) -> Indices:
        """Index (f,) of the region of each triangle; -1 for triangles of no region."""
        owner = np.full(len(self.mesh.faces), -1, dtype=np.int64)
        for index, region in enumerate(self.regions):
            owner[region.triangles] = index
        return owner


@dataclass(frozen=True)
class RegionInstance:
    """One region of one object in a frame."""

    object_id: int  # in the dataset
    name: str  # of the region
    mask: Mask  # (H, W) pixels that show the region
    # Share of the region's surface toward the camera inside the mask, 0 to 1. The inner side of an
    # open surface counts where the camera sees it.
    visible: float
    symmetries: tuple[Symmetry, ...]  # of the region, camera frame, metres


def visible_regions(
    label: NDArray[np.integer],  # (H, W) object id + 1, 0 = background, as in GraspNet
    intrinsics: Intrinsics,
    poses: Sequence[tuple[int, ArrayLike]],  # (object id, T_cam_obj (4, 4)) of the scene's objects
    objects: Mapping[int, RegionedObject],  # by id; a missing object has no regions
) -> list[RegionInstance]:
    """Return the regions with at least one visible pixel, in the order of `poses`."""
    instances = []
    for object_id, pose in poses:
        if object_id not in objects:
            continue
        posed, T_cam_obj = objects[object_id], np.asarray(pose, np.float64)
        owner = _region_image(posed, label == object_id + 1, intrinsics, T_cam_obj)
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
) -> Indices:
    """Return the index (H, W) of the region at each pixel of `shown`; -1 elsewhere."""
    image = np.full(shown.shape, -1, dtype=np.int64)
    only_whole = [len(region.triangles) for region in posed.regions] == [len(posed.mesh.faces)]
    if only_whole or not shown.any():
        image[shown] = 0
        return image
    T_obj_cam = invert(T_cam_obj)
    v, u = np.nonzero(shown)
    rays = intrinsics.points_at(np.stack([u, v], axis=1), np.ones(len(u)))
    origins = np.broadcast_to(T_obj_cam[:3, 3], rays.shape)
    triangle = first_hits(posed.mesh, origins, rotate_vectors(T_obj_cam, rays))[1]
    # Labels and poses agree to about a pixel: rays at the outline may miss the mesh.
    image[v, u] = np.where(triangle >= 0, posed.region_of_triangle[triangle], -1)
    return image


def _visible_share(
    mesh: Mesh, region: ObjectRegion, mask: Mask, intrinsics: Intrinsics, T_cam_obj: Array
) -> float:
    """Return the share of the surface samples facing the camera that project into `mask`."""
    part = mesh.submesh(region.triangles)
    samples, normals, _ = sample_surface(part, NUM_VISIBILITY_SAMPLES, np.random.default_rng(0))
    points, normals = transform_points(T_cam_obj, samples), rotate_vectors(T_cam_obj, normals)
    facing = np.einsum("ni,ni->n", points, normals) < 0.0
    if not mesh.is_watertight:
        facing |= _is_unhidden(mesh, samples, invert(T_cam_obj)[:3, 3])
    facing &= points[:, 2] > 0.0
    if not facing.any():
        return 0.0
    pixels, inside = intrinsics.pixels_of(points[facing])
    u, v = pixels[inside].T
    held = mask[v, u].sum()
    return float(held / facing.sum())


def _is_unhidden(mesh: Mesh, points: Array, eye: Array) -> Mask:
    """Return the mask (n,) of `points` (n, 3) of `mesh` that nothing hides from `eye` (3,)."""
    rays = points - eye
    distance, _ = first_hits(mesh, np.broadcast_to(eye, rays.shape), rays)
    return np.asarray(distance > (1.0 - UNHIDDEN) * np.linalg.norm(rays, axis=1))
