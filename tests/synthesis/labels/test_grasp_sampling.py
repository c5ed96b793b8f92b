"""Grasp labels against slow, plain checks; collisions in scenes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from pipelines.configs import LabelConfig
from pipelines.dataset.graspnet.graspnet_labels import GraspLabel
from pipelines.dataset.graspnet.graspnet_views import GRASP_DEPTHS, view_rotations
from pipelines.dataset.meshes import read_mesh
from pipelines.errors import ValueRangeError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.synthesis.labels.grasp_sampling import (
    LabelTarget,
    label_points,
    sample_grasp_label,
    scene_collisions,
)
from tests.synthesis import naive_labels

Array = NDArray[np.float64]

SIDES = np.array([0.04, 0.06, 0.10])
CONFIG = LabelConfig(num_points=12)
R = view_rotations().astype(np.float64)


def box() -> Mesh:
    made = trimesh.creation.box(SIDES)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


@pytest.fixture(scope="module")
def label() -> GraspLabel:
    return sample_grasp_label(box(), CONFIG, np.random.default_rng(5))


def naive(triangles: Array, label: GraspLabel, candidate: Array) -> tuple[float, float, bool]:
    point, view, angle, depth = (int(i) for i in candidate)
    return naive_labels.label(triangles, label.points[point].astype(float), view, angle, depth)


def assert_equals_naive(mesh: Mesh, label: GraspLabel, candidates: Array) -> None:
    for candidate in candidates:
        friction, width, collision = naive(mesh.triangles, label, candidate)
        at = tuple(candidate)
        assert label.min_friction[at] == pytest.approx(friction), at
        assert label.offsets[at][2] == pytest.approx(width, abs=1e-6), at
        assert label.collision[at] == collision, at


def cup() -> Mesh:
    """A cup of 5 cm with a wall of 3 mm: one finger inside, one outside holds it."""
    outer, inner = 0.025, 0.022
    outline = [[0, 0], [outer, 0], [outer, 0.08], [inner, 0.08], [inner, 0.003], [0, 0.003]]
    made = trimesh.creation.revolve(np.array(outline), sections=40)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def fork() -> Mesh:
    """Four tines on a bar, 6 mm apart: closer than a finger is thick."""
    parts = [trimesh.creation.box((0.03, 0.01, 0.004))]
    for x in (-0.0135, -0.0045, 0.0045, 0.0135):
        tine = trimesh.creation.box((0.003, 0.05, 0.004))
        parts.append(tine.apply_translation((x, 0.03, 0.0)))
    made = trimesh.util.concatenate(parts)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def blob() -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    dents = 1.0 + 0.25 * np.sin(130.0 * made.vertices).sum(axis=1, keepdims=True)
    return Mesh(made.vertices * dents, np.asarray(made.faces))


@pytest.mark.parametrize("make", [cup, fork, blob])
def test_friction_width_and_collision_equal_a_slow_check(make: Callable[[], Mesh]) -> None:
    mesh, rng = make(), np.random.default_rng(7)
    made = sample_grasp_label(mesh, LabelConfig(num_points=8), rng)
    anywhere = np.stack([rng.integers(0, n, 600) for n in made.min_friction.shape], axis=1)
    holding = rng.permutation(np.argwhere(made.min_friction > 0))[:100]
    free = rng.permutation(np.argwhere(~made.collision))[:100]
    assert len(free) > 20
    assert_equals_naive(mesh, made, np.concatenate([anywhere, holding, free]))


@pytest.mark.parametrize("name", ["ycb_035_power_drill", "ycb_025_mug", "os_scorpion"])
def test_real_meshes_equal_a_slow_check(shared: Path, name: str) -> None:
    mesh, rng = read_mesh(shared / "meshes" / f"{name}.ply"), np.random.default_rng(8)
    made = sample_grasp_label(mesh, LabelConfig(num_points=4), rng)
    anywhere = np.stack([rng.integers(0, n, 100) for n in made.min_friction.shape], axis=1)
    holding = rng.permutation(np.argwhere(made.min_friction > 0))[:30]
    assert_equals_naive(mesh, made, np.concatenate([anywhere, holding]))


def test_a_thin_wall_is_held_with_one_finger_inside_the_cup() -> None:
    # The widest opening would put the inner finger beyond the far wall: 5 cm of cup, 12 of opening.
    turn = np.linspace(0.1, 6.1, 6)
    rim = np.stack([0.0235 * np.cos(turn), 0.0235 * np.sin(turn), np.full(6, 0.08)], axis=1)
    made = label_points(LabelTarget.from_mesh(cup()), np.float32(rim), CONFIG)
    width = made.offsets[..., 2]
    free = ~made.collision & (width < 0.016)
    assert free.any(axis=(1, 2, 3)).all()
    assert np.isclose(width[free], 0.013, atol=0.0015).any()  # the wall and the margin


def test_fingers_close_across_a_gap_too_narrow_for_a_finger() -> None:
    made = sample_grasp_label(fork(), LabelConfig(num_points=12), np.random.default_rng(4))
    tines = made.points[:, 1] > 0.02
    free = ~made.collision[tines]
    assert (made.offsets[tines][free][:, 2] > 0.03).any()  # around all four tines


def test_another_grouping_of_the_points_gives_the_same_label() -> None:
    target, points = LabelTarget.from_mesh(box()), np.float32([[0.02, 0, 0], [0, 0.03, 0.01]])
    both = label_points(target, points, CONFIG)
    for i in range(2):
        one = label_points(target, points[i : i + 1], CONFIG)
        np.testing.assert_array_equal(one.offsets[0], both.offsets[i])
        np.testing.assert_array_equal(one.collision[0], both.collision[i])


def test_candidates_without_friction_are_marked_as_colliding(label: GraspLabel) -> None:
    without = label.min_friction < 0
    assert 0 < np.count_nonzero(without) < without.size
    assert label.collision[without].all()


def test_objects_wider_than_the_opening_are_infeasible(label: GraspLabel) -> None:
    target = LabelTarget.from_mesh(box())
    narrow = label_points(target, label.points, replace(CONFIG, max_width=0.05))
    wide = label.offsets[..., 2] > 0.0601  # the farther contact is beyond 25 mm
    assert (label.min_friction[wide] > 0).any()
    assert (narrow.min_friction[wide] < 0).all()
    slim = (label.min_friction > 0) & (label.offsets[..., 2] < 0.0599)
    np.testing.assert_array_equal(narrow.min_friction[slim], label.min_friction[slim])
    assert narrow.offsets[..., 2].max() <= np.float32(0.05)


def test_gripping_the_short_side_from_above_is_feasible_and_free() -> None:
    on_top = np.float32([[0.0, 0.0, 0.05], [0.009, -0.019, 0.05], [-0.005, 0.012, 0.05]])
    label = label_points(LabelTarget.from_mesh(box()), on_top, CONFIG)
    view, angle = np.nonzero((R[..., 2, 0] < -0.98) & (np.abs(R[..., 0, 1]) > 0.98))
    assert len(view)
    chosen = (slice(None), view, angle, slice(0, 2))  # tips 1 and 2 cm below the top
    assert (label.min_friction[chosen] > 0).all()
    assert not label.collision[chosen].any()


def test_a_palm_within_the_object_collides() -> None:
    # A plate's edge grip from the middle: feasible fingers, but the plate goes on behind them.
    made = trimesh.creation.box((0.2, 0.2, 0.01))
    plate = Mesh(np.asarray(made.vertices), np.asarray(made.faces))
    label = sample_grasp_label(plate, CONFIG, np.random.default_rng(3))
    inner = (np.abs(label.points[:, :2]) < 0.06).all(axis=1)
    across = np.abs(R[..., 2, 1]) > 0.9
    feasible = label.min_friction[inner][:, across] > 0
    assert feasible.sum() > 50
    assert label.collision[inner][:, across][feasible].all()


def test_same_seed_gives_same_arrays() -> None:
    few = LabelConfig(num_points=3)
    label, again = (sample_grasp_label(box(), few, np.random.default_rng(5)) for _ in range(2))
    for name in ("points", "offsets", "collision", "min_friction"):
        np.testing.assert_array_equal(getattr(again, name), getattr(label, name))


def test_a_grid_other_than_graspnets_is_refused() -> None:
    with pytest.raises(ValueRangeError, match="300"):
        sample_grasp_label(box(), LabelConfig(num_views=10), np.random.default_rng(0))


def lifted(x: float = 0.0, z: float = 0.05) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, z
    return pose


def collide(
    labels: list[GraspLabel], poses: list[Array], table_height: float = -9.0
) -> list[NDArray[np.bool_]]:
    meshes = [box() for _ in labels]
    return scene_collisions(labels, meshes, poses, table_height=table_height)


def test_an_object_alone_in_the_air_collides_only_with_itself(label: GraspLabel) -> None:
    [collision] = collide([label], [lifted()])
    np.testing.assert_array_equal(collision, label.collision)


def test_a_candidate_that_holds_at_no_friction_collides_in_every_scene(label: GraspLabel) -> None:
    # GraspNet's labels need not mark it as colliding with the object itself.
    unmarked = replace(label, collision=np.zeros_like(label.collision))
    [collision] = collide([unmarked], [lifted()])
    np.testing.assert_array_equal(collision, label.min_friction < 0)


def test_a_wall_forbids_the_approaches_that_reach_into_it(label: GraspLabel) -> None:
    wall = trimesh.creation.box((0.02, 0.6, 0.6))
    wall.apply_translation((0.032, 0.0, 0.05))
    beside = Mesh(np.asarray(wall.vertices), np.asarray(wall.faces))
    meshes, poses = [box()], [lifted()]
    [free] = scene_collisions([label], meshes, poses, table_height=-9.0)
    [walled] = scene_collisions([label], meshes, poses, table_height=-9.0, surroundings=[beside])
    near, from_wall = label.points[:, 0] > 0.019, R[..., 0, 0] < -0.5  # 2 mm before the wall
    assert near.any()
    assert (free & ~walled).sum() == 0
    assert walled[near][:, from_wall].all()
    assert (~free & walled).any()
    assert (~walled).any()


def test_the_table_forbids_approaches_from_below(label: GraspLabel) -> None:
    [collision] = collide([label], [lifted()], table_height=0.0)
    low = label.points[:, 2] < -0.035  # within 15 mm of the table
    upward = R[..., 2, 0] > 0.5
    assert (~label.collision[low][:, upward]).any()
    assert collision[low][:, upward].all()
    assert (~collision).any()


def test_the_table_meets_a_grasp_exactly_if_a_corner_is_below_it(label: GraspLabel) -> None:
    [collision] = collide([label], [lifted()], table_height=0.0)
    for candidate in np.argwhere(~label.collision):  # for few of them a centimetre decides
        point, view, angle, depth = candidate
        half = label.offsets[(*candidate, 2)] / 2 + 0.01
        corners = [
            label.points[point] + R[view, angle] @ (along, side, level)
            for along in (-0.03, GRASP_DEPTHS[depth])
            for side in (-half, half)
            for level in (-0.01, 0.01)
        ]
        assert collision[tuple(candidate)] == (min(corner[2] for corner in corners) < -0.05)


def test_a_neighbour_forbids_grasps_between_the_two(label: GraspLabel) -> None:
    collisions = collide([label, label], [lifted(), lifted(x=0.05)])
    for collision, toward in zip(collisions, (1.0, -1.0), strict=True):
        facing = toward * label.points[:, 0] > 0.0199
        from_there = R[..., 0, 0] * toward < -0.9  # the hand would stand in the neighbour
        assert (~label.collision[facing][:, from_there]).any()
        assert collision[facing][:, from_there].all()
        assert (collision >= label.collision).all()


def test_moving_the_whole_scene_changes_no_verdict(label: GraspLabel) -> None:
    turn = np.eye(4)
    turn[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    turn[:3, 3] = 0.3, -0.2, 0.5
    poses = [lifted(), lifted(x=0.07)]
    here = collide([label, label], poses, table_height=0.0)
    there = collide([label, label], [turn @ pose for pose in poses], table_height=0.5)
    for one, other in zip(here, there, strict=True):
        assert (one != other).mean() < 1e-5  # rounding at borders of boxes
