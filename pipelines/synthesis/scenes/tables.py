"""Scenes of objects at rest, their surroundings and views; world = table frame, z up."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices
from pipelines.configs import SceneryConfig, Surrounding
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import invert, make_pose, transform_points
from pipelines.synthesis.scenes.depth_faults import with_faults
from pipelines.synthesis.scenes.depth_sensors import measured_depth
from pipelines.synthesis.scenes.lamplight import (
    PLAIN_LOOK,
    Texture,
    drawn_lamps,
    drawn_lighting,
    drawn_look,
    drawn_texture,
    shade,
    table_texture,
)
from pipelines.synthesis.scenes.robot_hands import drawn_hand
from pipelines.synthesis.scenes.settling import drop_objects, middles_of
from pipelines.synthesis.scenes.smoothing import corner_normals, with_smooth_normals
from pipelines.synthesis.scenes.surroundings import (
    Container,
    SceneSurroundings,
    drawn_container,
    drawn_surroundings,
)
from pipelines.synthesis.scenes.varied_textures import varied_texture

TABLE_SIZE = (0.7, 0.5)  # metres, half extents
FLOOR_SIZE = 6.0
FLOOR_HEIGHTS = (-0.9, -0.5)
DROP_ATTEMPTS = 5
CENTERED = 1e-6  # metres; a smaller offset of a mesh from its origin is rounding


@dataclass(frozen=True)
class SceneObject:
    """One object of a scene: number in the dataset, mesh, and convex pieces for physics."""

    object_id: int
    name: str
    mesh: Mesh
    pieces: Sequence[Mesh]

    @cached_property
    def center(self) -> Array:
        """Middle (3,) of the bounding box, metres, object frame; exactly 0 for a centred mesh.

        The origin of a user's mesh may be at its foot, or metres away.
        """
        middle = np.asarray(self.mesh.bounds.mean(axis=0))
        return middle if np.linalg.norm(middle) > CENTERED else np.zeros(3)


@dataclass(frozen=True)
class View:
    """The images of one camera."""

    color: NDArray[np.uint8]  # (H, W, 3)
    depth: Array  # (H, W) metres as measured by the sensor, 0 = missing
    object_index: Indices  # (H, W) index among the scene's objects, -1 for everything else
    T_world_cam: Array  # (4, 4)


@dataclass(frozen=True)
class SceneLayout:
    """Objects at rest and their surroundings; `poses`: (k, 4, 4) object to table."""

    objects: tuple[SceneObject, ...]
    poses: Array
    surroundings: SceneSurroundings = field(default_factory=SceneSurroundings)

    @property
    def middles(self) -> Array:
        """Middles (k, 3) of the objects, metres, table frame."""
        return middles_of(self.poses, np.stack([item.center for item in self.objects]))

    @property
    def center(self) -> Array:
        """Mean (3,) of the objects' middles, metres, table frame."""
        return np.asarray(self.middles.mean(axis=0))

    @property
    def footprint(self) -> Array:
        """Points (n, 2) of the table below the corners of the objects' pieces, metres."""
        corners = [
            transform_points(pose, piece.vertices)[:, :2]
            for item, pose in zip(self.objects, self.poses, strict=True)
            for piece in item.pieces
        ]
        return np.concatenate(corners)


def check_object_counts(fewest: int, most: int) -> None:
    """Raise ValueRangeError if scenes of `fewest` to `most` objects are impossible."""
    if fewest > most:
        raise ValueRangeError("min_objects", fewest, f"at most max_objects, {most}")


def drawn_layout(
    objects: Sequence[SceneObject], kinds: Sequence[Surrounding], rng: np.random.Generator
) -> SceneLayout:
    """Return `objects` at rest in surroundings of one of `kinds`, as `SceneryConfig` lists them.

    Raises:
        SymgraspError: see `settle`.
    """
    if tuple(kinds) == ("plain",):
        return settle(objects, rng)
    (around,) = rng.spawn(1)  # a plain scene does not depend on the other listed kinds
    kind = kinds[int(around.integers(len(kinds)))]
    container = drawn_container(kind, around)
    layout = settle(objects, rng, container)
    surroundings = drawn_surroundings(kind, container, layout.footprint, around)
    return replace(layout, surroundings=surroundings)


def settle(
    objects: Sequence[SceneObject], rng: np.random.Generator, container: Container | None = None
) -> SceneLayout:
    """Drop `objects` until at least half of them stay on the table, or in the `container`.

    Raises:
        SymgraspError: all of `DROP_ATTEMPTS` attempts fail.
    """
    centers = np.stack([item.center for item in objects])
    for _ in range(DROP_ATTEMPTS):
        settled = drop_objects([item.pieces for item in objects], rng, centers, container)
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


def background(layout: SceneLayout, rng: np.random.Generator) -> tuple[list[Mesh], list[Array]]:
    """Return meshes and poses (4, 4) of the table, the floor and the objects' surroundings."""
    floor = make_pose(np.eye(3), [0, 0, rng.uniform(*FLOOR_HEIGHTS)])
    around = layout.surroundings
    meshes = [around.table or rectangle(*TABLE_SIZE), rectangle(FLOOR_SIZE, FLOOR_SIZE)]
    meshes += around.solids
    return meshes, [np.eye(4), floor, *[np.eye(4)] * len(around.solids)]


def record(
    layout: SceneLayout,
    viewpoints: Array,
    intrinsics: Intrinsics,
    sensor: str,
    rng: np.random.Generator,
    scenery: SceneryConfig | None = None,
) -> Iterator[View]:
    """Yield the views of `layout` by cameras at `viewpoints` (n, 4, 4), T_world_cam."""
    scenery = scenery or SceneryConfig()
    (beside,) = rng.spawn(1)  # for draws that only some scenes need
    meshes = [item.mesh for item in layout.objects]
    others, places = background(layout, rng)
    is_varied = scenery.colors == "varied"
    textures = _textures(layout, rng, beside, is_varied=is_varied)
    lamps = drawn_lamps(beside) if is_varied else [drawn_lighting(rng)]
    corners = [corner_normals(mesh) for mesh in meshes]
    whole = Scene([*meshes, *others], [*layout.poses, *places])
    for T_world_cam in viewpoints:
        scene, poses, shown = whole, np.array([*layout.poses, *places]), textures
        look = drawn_look(beside) if is_varied else PLAIN_LOOK
        if beside.uniform() < scenery.robot_hands:
            hand = drawn_hand(intrinsics, T_world_cam, beside)
            poses = np.concatenate([poses, T_world_cam[None]])
            scene = Scene([*meshes, *others, hand], list(poses))
            shown = [*textures, varied_texture(beside) if is_varied else drawn_texture(beside)]
        hits = cast_view(scene, intrinsics, T_world_cam)
        T_cam_obj = invert(T_world_cam) @ layout.poses
        curved = with_smooth_normals(hits, meshes, corners, T_cam_obj, intrinsics)
        color = shade(scene, curved, poses, shown, lamps, intrinsics, T_world_cam, rng, look)
        depth = measured_depth(sensor, scene, hits, intrinsics, T_world_cam, rng)
        if beside.uniform() < scenery.depth_faults:
            depth = with_faults(depth, color, hits.object_index, beside)
        objects = np.where(hits.object_index < len(layout.objects), hits.object_index, -1)
        yield View(color, depth, objects, T_world_cam)


def _textures(
    layout: SceneLayout, rng: np.random.Generator, beside: np.random.Generator, *, is_varied: bool
) -> list[Texture]:
    """Return one texture for each object, the table, the floor and each surrounding solid."""
    solids = len(layout.surroundings.solids)
    if is_varied:
        own = [varied_texture(beside, printed=True) for _ in layout.objects]
        table, floor, solid = (varied_texture(beside) for _ in range(3))
    else:
        own = [drawn_texture(rng) for _ in layout.objects]
        table, floor, solid = table_texture(rng), table_texture(rng), table_texture(beside)
    return [*own, table, floor, *[solid] * solids]
