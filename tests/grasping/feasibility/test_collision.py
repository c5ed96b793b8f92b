"""Gripper bodies against points: the fast code equals plain loops."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pipelines.configs import FeasibilityConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import (
    make_pose,
    random_rotation,
    rotate_vectors,
    transform_points,
    unit,
)
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.collision import (
    bodies_meet,
    clearance,
    first_free,
    lowest_height,
)
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.obstacles import Obstacles

GRIPPER = load_gripper("rg2")
seeds = st.integers(0, 2**31)


def random_grasps(rng, count=5):
    rotation = np.stack([random_rotation(rng) for _ in range(count)])
    return GraspPoses(rotation, rng.normal(0, 0.02, (count, 3)), rng.uniform(0.01, 0.1, count))


def random_scene(rng, count=400):
    return Obstacles(rng.uniform(-0.12, 0.12, (count, 3)), rng.integers(1, 4, count))


def boxes_of(grasps, index, margin):
    boxes = GRIPPER.boxes(grasps.width[index : index + 1])[0]
    return boxes[:, 0] - margin, boxes[:, 1] + margin


def naive_inside(grasps, index, scene, margin):
    local = (scene.points - grasps.translation[index]) @ grasps.rotation[index]
    low, high = boxes_of(grasps, index, margin)
    inside = [((local > lo) & (local < hi)).all(1) for lo, hi in zip(low, high, strict=True)]
    return int(scene.count[np.any(inside, axis=0)].sum())


def naive_enclosed(grasps, index, scene):
    local = (scene.points - grasps.translation[index]) @ grasps.rotation[index]
    low, high = boxes_of(grasps, index, 0.0)
    between = (np.abs(local[:, 1]) < low[1, 1]) & (np.abs(local[:, 2]) < high[1, 2])
    between &= (local[:, 0] < high[1, 0]) & (local[:, 0] > low[1, 0])
    return (high[1, 0] - local[between, 0]).max(initial=0.0)


@given(seeds, st.integers(0, 600), st.integers(0, 40))
@example(420, 400, 2)  # points in the corners of the margin
@settings(max_examples=40, deadline=None)
def test_grasps_collide_and_enclose_as_a_loop_finds(seed, count, allowed):
    rng = np.random.default_rng(seed)
    grasps, scene = random_grasps(rng, 15), random_scene(rng, count)
    config = FeasibilityConfig(body_margin=0.001, max_points_inside=allowed)
    met, enclosed = bodies_meet(grasps, GRIPPER, scene, config)
    for index in range(len(grasps)):
        expected = naive_inside(grasps, index, scene, 0.001) > allowed
        assert met[index] == expected
        height = 0.0 if expected else naive_enclosed(grasps, index, scene)
        np.testing.assert_allclose(enclosed[index], height, atol=1e-5)


def test_every_face_of_fingers_and_palm_is_moved_outward_by_the_margin():
    grasp = GraspPoses(np.eye(3), np.zeros(3), np.array(0.05))
    config = FeasibilityConfig(body_margin=0.001, max_points_inside=0)

    def is_met(point):
        return bodies_meet(grasp, GRIPPER, Obstacles(point[None], np.ones(1, int)), config)[0][0]

    low, high = boxes_of(grasp, 0, 0.0)
    for body, axis in np.ndindex(3, 3):
        outward = np.eye(3)[axis]
        for corner, side in ((low, -outward), (high, outward)):
            face = (low[body] + high[body]) / 2
            face[axis] = corner[body, axis]
            assert is_met(face + 0.0009 * side)
            behind_a_finger = body < 2 and axis == 0 and corner is low
            assert is_met(face + 0.0011 * side) == behind_a_finger  # there is the palm


@given(seeds, st.sampled_from([0, 3, 40]), st.sampled_from([0.0, 0.5, 1.0]), st.integers(1, 20))
@settings(max_examples=40, deadline=None)
def test_the_first_free_grasps_collide_with_nothing_and_enclose_something(seed, count, share, most):
    rng, config = np.random.default_rng(seed), FeasibilityConfig()
    grasps, scene = random_grasps(rng, 30)[np.arange(count) % 30], random_scene(rng, 20)
    stability = np.sort(np.round(rng.random(count), 1))[::-1].copy()
    met, enclosed = bodies_meet(grasps, GRIPPER, scene, config)
    expected = np.flatnonzero(~met & (enclosed >= config.min_enclosed))
    expected = expected[stability[expected] >= share * stability[expected].max(initial=0.0)][:most]
    found, height = first_free(grasps, GRIPPER, scene, config, stability, (share, most))
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(height, enclosed[expected])


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_moving_gripper_and_scene_together_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    grasps, scene = random_grasps(rng, 40), random_scene(rng)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    moved = Obstacles(transform_points(T, scene.points), scene.count)
    config = FeasibilityConfig(body_margin=0.001, max_points_inside=4)
    here, _ = bodies_meet(grasps, GRIPPER, scene, config)
    there, _ = bodies_meet(grasps.transformed(T), GRIPPER, moved, config)
    assert (here == there).mean() > 0.9  # a point on a box's face may flip
    found = clearance(grasps.transformed(T), GRIPPER, moved, 0.05)
    np.testing.assert_allclose(found, clearance(grasps, GRIPPER, scene, 0.05), atol=1e-5)


@given(seeds, st.sampled_from([0, 1, 12, 500]))
@settings(max_examples=30, deadline=None)
def test_the_clearance_equals_the_shortest_distance_of_a_loop(seed, count):
    rng = np.random.default_rng(seed)
    grasps, scene = random_grasps(rng, 40), random_scene(rng, count)
    found = clearance(grasps, GRIPPER, scene, 0.05)
    for index in range(len(grasps)):
        local = (scene.points - grasps.translation[index]) @ grasps.rotation[index]
        low, high = boxes_of(grasps, index, 0.0)
        gaps = [
            np.linalg.norm(np.maximum(np.maximum(lo - local, local - hi), 0), axis=1)
            for lo, hi in zip(low, high, strict=True)
        ]
        np.testing.assert_allclose(found[index], np.min(gaps, initial=0.05), atol=1e-5)


def test_the_nearest_point_counts_even_if_the_middle_of_its_cube_is_farther():
    grasp = GraspPoses(np.eye(3), np.zeros(3), np.array(0.05))
    side = boxes_of(grasp, 0, 0.0)[1][1, 1]  # outer face of the second finger
    # Next to the finger: a cube with points 10 and 28 mm away, another with a point 12 mm away.
    points = [[-0.03, side + 0.010, 0.0], [-0.03, side + 0.028, 0.0], [-0.005, side + 0.012, 0.0]]
    found = clearance(grasp, GRIPPER, Obstacles(np.array(points), np.ones(3, int)), 0.05)
    np.testing.assert_allclose(found, 0.010, atol=1e-6)


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_the_lowest_height_is_the_height_of_the_lowest_corner(seed):
    rng = np.random.default_rng(seed)
    grasps, plane = random_grasps(rng), Plane(unit(rng.normal(size=3)), float(rng.normal()))
    found = lowest_height(grasps, GRIPPER, plane)
    for index in range(len(grasps)):
        low, high = boxes_of(grasps, index, 0.0)
        corners = [
            np.where([i & 1, i & 2, i & 4], hi, lo)
            for lo, hi in zip(low, high, strict=True)
            for i in range(8)
        ]
        placed = rotate_vectors(grasps.rotation[index], corners) + grasps.translation[index]
        np.testing.assert_allclose(found[index], plane.height(placed).min(), atol=1e-12)
