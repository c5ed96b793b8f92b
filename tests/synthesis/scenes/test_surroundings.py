"""Bins hold the objects, walls and edges stay clear of them, cameras see past both."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.configs import SceneryConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.rendering import Scene
from pipelines.geometry.transforms import transform_points
from pipelines.synthesis.scenes.cameras import drawn_viewpoints
from pipelines.synthesis.scenes.robot_hands import drawn_hand
from pipelines.synthesis.scenes.surroundings import drawn_container
from pipelines.synthesis.scenes.tables import (
    SceneLayout,
    SceneObject,
    background,
    drawn_layout,
    record,
)
from tests.metrics.shapes import box

LENS = Intrinsics(150.0, 150.0, 79.5, 59.5, 160, 120)
SEEDS = range(3)
BLOCK = box(0.05, 0.06, 0.08)


def blocks(count: int) -> list[SceneObject]:
    return [SceneObject(i, f"{i:03d}", BLOCK, (BLOCK,)) for i in range(count)]


def layouts(kind: str) -> list[SceneLayout]:
    return [drawn_layout(blocks(3), (kind,), np.random.default_rng(seed)) for seed in SEEDS]


def corners(layout: SceneLayout) -> np.ndarray:
    return np.concatenate([transform_points(pose, BLOCK.vertices) for pose in layout.poses])


def depth_in(solid, points: np.ndarray) -> float:
    """Return how deep the deepest of `points` lies in a convex solid, metres."""
    offset = np.einsum("fi,fi->f", solid.triangles[:, 0], solid.face_normals)
    return float(-(points @ solid.face_normals.T - offset).max(axis=1).min())


def viewpoints(layout: SceneLayout) -> np.ndarray:
    around = layout.surroundings
    rng = np.random.default_rng(0)
    return drawn_viewpoints(layout.center, 4, LENS, rng, around.arc, around.elevations)


@pytest.mark.parametrize("kind", ["bin", "tray"])
def test_objects_rest_in_a_container_and_not_in_its_walls(kind):
    for layout in layouts(kind):
        solids = layout.surroundings.solids
        floor = solids[0].bounds
        assert floor[0, 2] == 0.0
        assert corners(layout)[:, 2].min() > floor[1, 2] - 0.003
        middles = np.array([solid.bounds.mean(axis=0) for solid in solids])
        assert (
            np.linalg.norm(layout.middles[:, :2], axis=1).max()
            < np.linalg.norm(middles[1:, :2], axis=1).max()
        )
        assert max(depth_in(solid, corners(layout)) for solid in solids) < 0.004


@pytest.mark.parametrize("kind", ["wall", "base"])
def test_walls_and_bases_stand_clear_of_all_objects(kind):
    for layout in layouts(kind):
        assert layout.surroundings.solids
        for solid in layout.surroundings.solids:
            gap = np.linalg.norm(solid.vertices[:, None, :2] - layout.footprint[None], axis=2).min()
            assert gap > 0.003
            assert depth_in(solid, corners(layout)) < 0.0


def test_a_table_ends_outside_the_objects_and_not_under_them():
    for layout in layouts("edge"):
        table = layout.surroundings.table
        assert table.bounds[1, 2] == 0.0
        under = np.column_stack([layout.footprint, np.full(len(layout.footprint), -1e-3)])
        assert all(depth_in(table, point[None]) > 0.0 for point in under)
        assert max(np.linalg.norm(v[:2]) for v in table.vertices) < 2.2


@pytest.mark.parametrize("kind", ["bin", "tray", "wall", "edge", "base"])
def test_cameras_see_objects_and_not_the_back_of_a_wall(kind):
    for layout in layouts(kind):
        others, places = background(layout, np.random.default_rng(1))
        scene = Scene([*[BLOCK] * len(layout.poses), *others], [*layout.poses, *places])
        for T_world_cam in viewpoints(layout):
            eye = T_world_cam[:3, 3]
            _, triangle = scene.cast(np.tile(eye, (len(layout.poses), 1)), layout.middles - eye)
            assert (scene.owner(triangle)[0] < len(layout.poses)).mean() > 0.3


def test_surroundings_are_background_and_a_hand_hides_what_is_behind_it():
    for layout in layouts("wall"):
        pose = viewpoints(layout)[:1]
        shown = {}
        for share in (0.0, 1.0):
            rng = np.random.default_rng(4)
            scenery = SceneryConfig(robot_hands=share)
            (shown[share],) = record(layout, pose, LENS, "perfect", rng, scenery)
        assert shown[0.0].object_index.max() < len(layout.objects)
        nearer = (shown[1.0].depth > 0) & (shown[1.0].depth < shown[0.0].depth - 0.01)
        assert 0.005 < nearer.mean() < 0.6
        assert (shown[1.0].object_index[nearer] == -1).all()
        border = np.ones_like(nearer)
        border[1:-1, 1:-1] = False
        assert nearer[border].any()  # the hand comes from outside


def test_a_hand_in_the_scene_stays_above_the_table():
    layout = layouts("plain")[0]
    for seed in range(20):
        for pose in viewpoints(layout)[:2]:
            hand = drawn_hand(LENS, pose, np.random.default_rng(seed))
            tip = transform_points(pose, hand.vertices[:8])
            assert tip[:, 2].max() > 0.0


def test_a_plain_scene_does_not_depend_on_the_other_listed_surroundings():
    alone = drawn_layout(blocks(3), ("plain",), np.random.default_rng(2))
    listed = drawn_layout(blocks(3), ("plain", "plain"), np.random.default_rng(2))
    assert_array_equal(alone.poses, listed.poses)
    assert listed.surroundings.solids == ()
    views = [
        next(record(each, viewpoints(alone)[:1], LENS, "kinect", np.random.default_rng(5)))
        for each in (alone, replace(listed))
    ]
    assert_array_equal(views[0].color, views[1].color)
    assert_array_equal(views[0].depth, views[1].depth)


def test_only_bins_and_trays_are_containers():
    rng = np.random.default_rng(0)
    assert drawn_container("wall", rng) is None
    low, high = drawn_container("tray", rng), drawn_container("bin", rng)
    assert max(s.bounds[1, 2] for s in low.solids) < max(s.bounds[1, 2] for s in high.solids)
    assert all(solid.is_watertight and solid.volume > 0 for solid in (*low.solids, *high.solids))
