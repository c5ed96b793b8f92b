"""Grasp labels of a box against slow, obvious checks; collisions in scenes."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from pipelines.configs import LabelConfig
from pipelines.errors import ValueRangeError
from pipelines.formats.graspnet_labels import GraspLabel
from pipelines.formats.graspnet_views import DEPTHS, view_rotations
from pipelines.geometry.mesh import Mesh, sample_surface
from pipelines.synthesis.grasp_sampling import NUM_SAMPLES, sample_grasp_label, scene_collisions

Array = NDArray[np.float64]

SIDES = np.array([0.04, 0.06, 0.10])
CONFIG = LabelConfig(num_points=24)
R = view_rotations().astype(np.float64)


def box() -> Mesh:
    made = trimesh.creation.box(SIDES)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


@pytest.fixture(scope="module")
def label() -> GraspLabel:
    return sample_grasp_label(box(), CONFIG, np.random.default_rng(5))


def some_candidates(label: GraspLabel, count: int, *, feasible: bool) -> Array:
    index = np.argwhere((label.min_friction > 0) == feasible)
    return np.random.default_rng(1).permutation(index)[:count]


def line_through_box(tip: Array, closing: Array) -> tuple[float, float, int, int]:
    """Where the line `tip + s * closing` enters and leaves the box, and across which axes."""
    enter, leave, enter_axis, leave_axis = -np.inf, np.inf, 0, 0
    for axis in range(3):
        half = SIDES[axis] / 2
        with np.errstate(divide="ignore"):  # parallel to two faces: infinitely far ends are right
            ends = sorted((side - tip[axis]) / closing[axis] for side in (-half, half))
        if ends[0] > enter:
            enter, enter_axis = ends[0], axis
        if ends[1] < leave:
            leave, leave_axis = ends[1], axis
    return enter, leave, enter_axis, leave_axis


def slow_friction_and_width(tip: Array, closing: Array) -> tuple[float, float]:
    """What the label must say of one candidate, from the planes of the box alone."""
    enter, leave, enter_axis, leave_axis = line_through_box(tip, closing)
    if not -0.06 <= enter <= 0.0 <= leave <= 0.06:
        return -1.0, 0.0
    angles = [np.arccos(abs(closing[axis])) for axis in (enter_axis, leave_axis)]
    needed = max(np.tan(angles))
    holding = [mu / 10 for mu in range(1, 11) if mu / 10 >= needed]
    return (holding[0] if holding else -1.0), min(2 * max(-enter, leave) + 0.01, 0.12)


@pytest.mark.parametrize("feasible", [True, False])
def test_friction_and_width_equal_those_of_a_slow_check(label: GraspLabel, feasible: bool) -> None:
    candidates = some_candidates(label, 200, feasible=feasible)
    assert len(candidates) == 200
    for point, view, angle, depth in candidates:
        frame = R[view, angle]
        tip = label.points[point] + DEPTHS[depth] * frame[:, 0]
        friction, width = slow_friction_and_width(tip, frame[:, 1])
        assert label.min_friction[point, view, angle, depth] == pytest.approx(friction)
        assert label.offsets[point, view, angle, depth, 2] == pytest.approx(width, abs=1e-6)


def slow_collision(samples: Array, origin: Array, frame: Array, depth: float, width: float) -> bool:
    for along, side, level in (samples - origin) @ frame:
        if abs(level) >= 0.01:
            continue
        finger = -0.02 < along < depth and width / 2 < abs(side) < width / 2 + 0.01
        slab = -0.03 < along < -0.02 and abs(side) < width / 2 + 0.01
        if finger or slab:
            return True
    return False


def test_self_collision_equals_that_of_a_slow_check(label: GraspLabel) -> None:
    rng = np.random.default_rng(5)
    sample_surface(box(), CONFIG.num_points, rng)
    samples = sample_surface(box(), NUM_SAMPLES, rng)[0]
    verdicts = []
    for candidate in some_candidates(label, 200, feasible=True):
        point, view, angle, depth = candidate
        width = float(label.offsets[(*candidate, 2)])
        if width > 0.1199:  # opened to the end, a finger may just touch: a tie
            continue
        verdict = slow_collision(samples, label.points[point], R[view, angle], DEPTHS[depth], width)
        assert label.collision[tuple(candidate)] == verdict
        verdicts.append(verdict)
    assert 20 < sum(verdicts) < 180


def test_candidates_without_friction_are_marked_as_colliding(label: GraspLabel) -> None:
    assert label.collision[label.min_friction < 0].all()


def test_objects_wider_than_the_opening_are_infeasible(label: GraspLabel) -> None:
    narrow = sample_grasp_label(box(), replace(CONFIG, max_width=0.05), np.random.default_rng(5))
    wide = label.offsets[..., 2] > 0.0601  # farther contact beyond 25 mm
    assert (label.min_friction[wide] > 0).any()
    assert (narrow.min_friction[wide] < 0).all()
    slim = (label.min_friction > 0) & (label.offsets[..., 2] < 0.0599)
    np.testing.assert_array_equal(narrow.min_friction[slim], label.min_friction[slim])
    assert narrow.offsets[..., 2].max() <= np.float32(0.05)


def test_gripping_the_short_side_from_above_is_feasible_and_free() -> None:
    label = sample_grasp_label(box(), LabelConfig(num_points=48), np.random.default_rng(2))
    x, y, _ = np.abs(label.points).T
    on_top = (label.points[:, 2] > 0.0499) & (x < 0.01) & (y < 0.02)
    assert on_top.any()
    view, angle = np.nonzero((R[..., 2, 0] < -0.98) & (np.abs(R[..., 0, 1]) > 0.98))
    assert len(view)
    chosen = (slice(None), view, angle, slice(0, 2))  # tips 1 and 2 cm below the top
    assert (label.min_friction[chosen][on_top] > 0).all()
    assert not label.collision[chosen][on_top].any()


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


def test_same_seed_gives_same_arrays(label: GraspLabel) -> None:
    again = sample_grasp_label(box(), CONFIG, np.random.default_rng(5))
    for name in ("points", "offsets", "collision", "min_friction"):
        np.testing.assert_array_equal(getattr(again, name), getattr(label, name))


def test_another_grid_than_graspnets_is_refused() -> None:
    with pytest.raises(ValueRangeError, match="300"):
        sample_grasp_label(box(), LabelConfig(num_views=10), np.random.default_rng(0))


def lifted(x: float = 0.0, z: float = 0.05) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, z
    return pose


def collide(
    labels: list[GraspLabel], poses: list[Array], table_height: float = -9.0
) -> list[NDArray[np.bool_]]:
    rng = np.random.default_rng(0)
    meshes = [box() for _ in labels]
    return scene_collisions(
        labels, meshes, poses, config=CONFIG, rng=rng, table_height=table_height
    )


def test_an_object_alone_in_the_air_collides_only_with_itself(label: GraspLabel) -> None:
    [collision] = collide([label], [lifted()])
    np.testing.assert_array_equal(collision, label.collision)


def test_the_table_forbids_approaches_from_below(label: GraspLabel) -> None:
    [collision] = collide([label], [lifted()], table_height=0.0)
    low = label.points[:, 2] < -0.035  # within 15 mm of the table
    upward = R[..., 2, 0] > 0.5
    assert (~label.collision[low][:, upward]).any()
    assert collision[low][:, upward].all()
    assert (~collision).any()


def test_the_table_meets_a_grasp_exactly_if_a_corner_is_below_it(label: GraspLabel) -> None:
    [collision] = collide([label], [lifted()], table_height=0.0)
    for candidate in np.random.default_rng(1).permutation(np.argwhere(~label.collision))[:200]:
        point, view, angle, depth = candidate
        half = label.offsets[(*candidate, 2)] / 2 + 0.01
        corners = [
            label.points[point] + R[view, angle] @ (along, side, level)
            for along in (-0.03, DEPTHS[depth])
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
        assert (one != other).mean() < 1e-5  # rounding, at borders of boxes
