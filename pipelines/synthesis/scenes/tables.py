"""Scenes of objects settled on a table, and views of them; world frame = table frame, z up."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices
from pipelines.errors import SymgraspError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import invert, make_pose
from pipelines.synthesis.scenes.depth_sensors import measured_depth
from pipelines.synthesis.scenes.lamplight import drawn_lighting, drawn_texture, shade, table_texture
from pipelines.synthesis.scenes.settling import drop_objects, middles_of
from pipelines.synthesis.scenes.smoothing import corner_normals, with_smooth_normals

TABLE_SIZE = (0.7, 0.5)  # metres, half extents
FLOOR_SIZE = 6.0
FLOOR_HEIGHTS = (-0.9, -0.5)
DROP_ATTEMPTS = 5
CENTRED = 1e-6  # metres; a smaller offset of a mesh from its origin is rounding


@dataclass(frozen=True)
class SceneObject:
    """One object of a scene: number in the dataset, mesh, and convex pieces for physics."""

    object_id: int
    name: str
    mesh: Mesh
    pieces: Sequence[Mesh]

    @cached_property
    def centre(self) -> Array:
        """Middle (3,) of the bounding box, metres, object frame; exactly 0 for a centred mesh.

        The origin of a user's mesh may be at its foot, or metres away.
        """
        middle = np.asarray(self.mesh.bounds.mean(axis=0))
        return middle if np.linalg.norm(middle) > CENTRED else np.zeros(3)


@dataclass(frozen=True)
class View:
    """The images of one camera.

    Attributes:
        color: (H, W, 3) uint8.
        depth: (H, W) metres as measured by the sensor, 0 = missing.
        object_index: (H, W) index among the scene's objects, -1 for table, floor, nothing.
        T_world_cam: (4, 4).
    """

    color: NDArray[np.uint8]
    depth: Array
    object_index: Indices
    T_world_cam: Array


@dataclass(frozen=True)
class SceneLayout:
    """Objects at rest; `poses`: (k, 4, 4) object to table."""

    objects: tuple[SceneObject, ...]
    poses: Array

    @property
    def middles(self) -> Array:
        """Middles (k, 3) of the objects, metres, table frame."""
        return middles_of(self.poses, np.stack([item.centre for item in self.objects]))

    @property
    def centre(self) -> Array:
        """Mean (3,) of the objects' middles, metres, table frame."""
        return np.asarray(self.middles.mean(axis=0))


def settle(objects: Sequence[SceneObject], rng: np.random.Generator) -> SceneLayout:
    """Drop `objects` until at least half of them stay on the table.

    Raises:
        SymgraspError: they do not in `DROP_ATTEMPTS` attempts.
    """
    centres = np.stack([item.centre for item in objects])
    for _ in range(DROP_ATTEMPTS):
        settled = drop_objects([item.pieces for item in objects], rng, centres)
        if 2 * len(settled.index) >= len(objects):
            return SceneLayout(tuple(objects[i] for i in settled.index), settled.poses)
    raise SymgraspError(
        f"objects {[item.name for item in objects]} do not come to rest on the table in "
        f"{DROP_ATTEMPTS} attempts; objects of 3 to 25 cm with convex pieces do"
    )


def rectangle(half_width: float, half_depth: float) -> Mesh:
    """Return a level rectangle at z = 0, facing up."""
    x, y = half_width, half_depth
    corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def record(
    layout: SceneLayout,
    viewpoints: Array,
    intrinsics: Intrinsics,
    sensor: str,
    rng: np.random.Generator,
) -> Iterator[View]:
    """Yield the views of `layout` by cameras at `viewpoints` (n, 4, 4), T_world_cam."""
    floor = make_pose(np.eye(3), [0, 0, rng.uniform(*FLOOR_HEIGHTS)])
    poses = np.concatenate([layout.poses, np.eye(4)[None], floor[None]])
    ground = [rectangle(*TABLE_SIZE), rectangle(FLOOR_SIZE, FLOOR_SIZE)]
    scene = Scene([*(item.mesh for item in layout.objects), *ground], list(poses))
    textures = [drawn_texture(rng) for _ in layout.objects]
    textures += [table_texture(rng), table_texture(rng)]
    lighting = drawn_lighting(rng)
    meshes = [item.mesh for item in layout.objects]
    corners = [corner_normals(mesh) for mesh in meshes]
    for T_world_cam in viewpoints:
        hits = cast_view(scene, intrinsics, T_world_cam)
        T_cam_obj = invert(T_world_cam) @ layout.poses
        curved = with_smooth_normals(hits, meshes, corners, T_cam_obj, intrinsics)
        yield View(
            shade(scene, curved, poses, textures, lighting, intrinsics, T_world_cam, rng),
            measured_depth(sensor, scene, hits, intrinsics, T_world_cam, rng),
            np.where(hits.object_index < len(layout.objects), hits.object_index, -1),
            T_world_cam,
        )
