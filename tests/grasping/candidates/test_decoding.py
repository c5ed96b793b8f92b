"""From predictions to contact pairs."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SelectionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import (
    invert,
    make_pose,
    random_rotation,
    rotate_vectors,
    transform_points,
    unit,
)
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.candidates.decoding import (
    _best_images,
    average_symmetries,
    contact_pairs,
    graspable,
    in_observed_frustum,
    weighted_median,
)
from pipelines.grasping.observation import RegionCloud, SceneCloud
from tests.geometry.tabletops import CAMERA, Box, Can, looking_at_table, render

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")
seeds = st.integers(0, 2**31)


def noisy_predictions(rng, count=200):
    normals = unit(rng.normal(size=(5, 3)))
    direction = unit(normals + 0.02 * rng.normal(size=(count, 5, 3)))
    direction *= rng.choice([-1.0, 1.0], (count, 5, 1))
    point = rng.normal(size=(5, 3)) + 0.001 * rng.normal(size=(count, 5, 3))
    existence = np.clip(rng.uniform(size=5) + 0.05 * rng.normal(size=(count, 5)), 0, 1)
    return normals, existence, point, direction, rng.uniform(size=count)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_opposite_normals_average_to_their_plane(seed):
    rng = np.random.default_rng(seed)
    normals, existence, point, direction, affordance = noisy_predictions(rng)
    slots = average_symmetries(existence, point, direction, affordance)
    cosine = np.abs(np.einsum("ki,ki->k", slots.direction[:4], normals[:4]))
    assert (cosine > np.cos(0.02)).all()
    np.testing.assert_allclose(slots.point, point.mean(axis=0), atol=0.002)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_moving_the_predictions_moves_the_average(seed):
    rng = np.random.default_rng(seed)
    _, existence, point, direction, affordance = noisy_predictions(rng)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    here = average_symmetries(existence, point, direction, affordance).transformed(T)
    there = average_symmetries(
        existence, transform_points(T, point), rotate_vectors(T, direction), affordance
    )
    cosine = np.einsum("ki,ki->k", here.direction[:4], there.direction[:4])
    np.testing.assert_allclose(np.abs(cosine), 1.0, atol=1e-9)
    np.testing.assert_allclose(here.point, there.point, atol=0.002)  # medians turn with the axes
    np.testing.assert_allclose(here.existence, there.existence)


def test_points_without_affordance_do_not_vote():
    rng = np.random.default_rng(0)
    normals, existence, point, direction, affordance = noisy_predictions(rng)
    affordance[100:], direction[100:] = 0.0, unit(rng.normal(size=(100, 5, 3)))
    slots = average_symmetries(existence, point, direction, affordance)
    assert (np.abs(np.einsum("ki,ki->k", slots.direction[:4], normals[:4])) > 0.999).all()


def test_the_weighted_median_ignores_outliers():
    assert weighted_median(np.array([3.0, 1.0, 2.0, 900.0]), np.ones(4)) == 2.0
    assert weighted_median(np.array([0.0, 5.0]), np.array([0.1, 1.0])) == 5.0


@given(seeds, st.integers(1, 40))
@settings(max_examples=25, deadline=None)
def test_half_of_the_weight_does_not_exceed_the_weighted_median(seed, count):
    rng = np.random.default_rng(seed)
    values, weight = rng.integers(9, size=(2, 3, count)) / 8, rng.uniform(size=count)
    found = weighted_median(values, weight)
    assert found.shape == (2, 3)
    for row, median in zip(values.reshape(6, count), found.reshape(6), strict=True):
        half = 0.5 * weight.sum()
        assert median == min(v for v in row if weight[row <= v].sum() >= half - 1e-12)


def test_each_slots_prediction_is_averaged_as_if_it_were_alone():
    _, existence, point, direction, affordance = noisy_predictions(np.random.default_rng(5))
    existence[:, 1] = 0.0  # no point says that there is one: all count
    slots = average_symmetries(existence, point, direction, affordance)
    for slot in range(5):
        trust = affordance * existence[:, slot] if slot != 1 else affordance
        centre = weighted_median(point[:, slot].T, trust)
        if slot < 4:
            d = direction[:, slot]
            axis = np.linalg.eigh((trust * d.T) @ d)[1][:, 2]
            axis = axis if axis[np.abs(axis).argmax()] > 0 else -axis
            np.testing.assert_allclose(slots.direction[slot], axis, atol=1e-12)
        if slot < 3:
            centre += (weighted_median(point[:, slot] @ axis, trust) - centre @ axis) * axis
        np.testing.assert_allclose(slots.point[slot], centre, atol=1e-12)
    assert np.isnan(slots.direction[4]).all()


def test_high_affordance_is_above_one_half_where_there_is_any():
    np.testing.assert_array_equal(graspable(np.array([0.4, 0.6, 0.9]), CONFIG), [0, 1, 1])


def test_where_no_affordance_is_high_the_best_count_unless_weak():
    np.testing.assert_array_equal(graspable(np.array([0.1, 0.38, 0.4]), CONFIG), [0, 1, 1])
    assert not graspable(np.array([0.01, 0.05]), CONFIG).any()


def test_the_frustum_filter_rejects_what_floats_before_the_surface():
    depth, _ = render([])
    scene = SceneCloud(depth, CAMERA)
    on_table = scene.xyz[120, 160]
    points = np.stack([on_table, 0.8 * on_table, 1.2 * on_table, on_table - [0, 0, 0.003]])
    np.testing.assert_array_equal(in_observed_frustum(points, scene, CONFIG), [1, 0, 1, 1])


def test_the_frustum_filter_rejects_what_is_outside_the_picture_or_behind_the_camera():
    scene = SceneCloud(render([])[0], CAMERA)
    points = np.array([[2.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert not in_observed_frustum(points, scene, CONFIG).any()


def test_the_frustum_filter_takes_points_that_touch_the_lens():
    scene = SceneCloud(render([])[0], CAMERA)
    points = np.array([[0.0, 0.0, 1e-30]] * 2)
    assert in_observed_frustum(points, scene, CONFIG).shape == (2,)


def test_what_was_not_measured_may_be_real():
    scene = SceneCloud(np.zeros((240, 320)), CAMERA)
    assert in_observed_frustum(np.array([[0.0, 0.0, 0.5]]), scene, CONFIG).all()


def box_seen():
    pose = looking_at_table()
    depth, index = render([Box((0.06, 0.09, 0.1))], pose)
    scene = SceneCloud(depth, CAMERA)
    region = RegionCloud.from_mask(index == 0, scene)
    middle = transform_points(pose, [0, 0, 0.05])
    planes = [ReflectionSymmetry(pose[:3, axis], middle) for axis in (0, 1)]
    return pose, scene, region, SymmetrySlots.from_symmetries(planes)


def test_counterparts_lie_across_the_box():
    _, scene, region, slots = box_seen()
    pairs = contact_pairs(region, scene, slots, np.ones(len(region)), GRIPPER, CONFIG)
    width = np.linalg.norm(pairs.contacts[:, 1] - pairs.contacts[:, 0], axis=1)
    assert len(pairs) > 5
    front = pairs.slot == 1
    np.testing.assert_allclose(width[front], 0.09, atol=0.004)


def test_of_two_planes_the_one_across_the_points_normal_is_taken():
    pose, scene, region, slots = box_seen()
    pairs = contact_pairs(region, scene, slots, np.ones(len(region)), GRIPPER, CONFIG)
    line = unit(pairs.contacts[:, 1] - pairs.contacts[:, 0])
    across = np.abs(line @ pose[:3, :2])  # cosines to the two planes' normals
    np.testing.assert_array_equal(across.argmax(axis=1), pairs.slot)
    assert (pairs.alignment > np.cos(CONFIG.max_contact_angle)).all()


def test_a_false_symmetry_gives_no_pairs_in_free_space():
    pose, scene, region, _ = box_seen()
    # Mirroring the front face in a plane before it puts counterparts into the air.
    before = ReflectionSymmetry(pose[:3, 1], transform_points(pose, [0, -0.075, 0.05]))
    slots = SymmetrySlots.from_symmetries([before])
    pairs = contact_pairs(region, scene, slots, np.ones(len(region)), GRIPPER, CONFIG)
    height = transform_points(invert(pose), pairs.contacts[:, 1])[:, 2]
    assert (height < 0.025).all()  # what is left lies on the table, to within noise
    mirrored = before.counterpart(region.points)
    assert (transform_points(invert(pose), mirrored)[:, 2] > 0.025).mean() > 0.5


def test_pairs_across_an_axis_are_as_wide_as_the_can():
    pose = looking_at_table()
    depth, index = render([Can(0.035, 0.12)], pose)
    scene = SceneCloud(depth, CAMERA)
    region = RegionCloud.from_mask(index == 0, scene)
    axis = RotationSymmetry(pose[:3, 2], transform_points(pose, [0, 0, 0]))
    slots = SymmetrySlots.from_symmetries([axis])
    pairs = contact_pairs(region, scene, slots, np.ones(len(region)), GRIPPER, CONFIG)
    width = np.linalg.norm(pairs.contacts[:, 1] - pairs.contacts[:, 0], axis=1)
    assert len(pairs) > 5
    np.testing.assert_allclose(width, 0.07, atol=0.004)


def test_pairs_wider_than_the_gripper_are_left_out():
    _, scene, region, slots = box_seen()
    narrow = replace(GRIPPER, max_opening=0.08)
    pairs = contact_pairs(region, scene, slots, np.ones(len(region)), narrow, CONFIG)
    width = np.linalg.norm(pairs.contacts[:, 1] - pairs.contacts[:, 0], axis=1)
    assert (width < narrow.max_width).all()


@given(seeds, st.sampled_from([0.02, 0.3, 0.6]))
@settings(max_examples=25, deadline=None)
def test_the_frustum_filter_looks_at_the_nearest_pixel_about_a_point(seed, unseen):
    rng = np.random.default_rng(seed)
    camera = Intrinsics(900.0, 900.0, 15.0, 11.0, 32, 24)
    depth = rng.uniform(0.45, 0.6, (24, 32)) * (rng.uniform(size=(24, 32)) > unseen)
    depth[:, :16] *= rng.integers(2)  # no depth at all about some points
    points = np.column_stack([rng.uniform(-0.01, 0.01, (80, 2)), rng.uniform(0.4, 0.6, 80)])
    points[::9, 2] *= -1.0
    found = in_observed_frustum(points, SceneCloud(depth, camera), CONFIG)
    pixels, inside = camera.pixels_of(points)
    radius = round(CONFIG.behind_tolerance * camera.fx / np.median(points[inside, 2]))
    assert radius > 1
    for (u, v), z, shown, real in zip(pixels, points[:, 2], inside, found, strict=True):
        window = depth[max(v - radius, 0) : v + radius + 1, max(u - radius, 0) : u + radius + 1]
        nearest = min(window[window > 0], default=0.0) if shown else np.inf
        assert real == (z > nearest - CONFIG.behind_tolerance - CONFIG.depth_noise * z**2)


def test_the_frustum_filter_takes_no_points():
    scene = SceneCloud(render([])[0], CAMERA)
    assert in_observed_frustum(np.zeros((0, 3)), scene, CONFIG).shape == (0,)


@given(seeds, st.integers(0, 30))
@settings(max_examples=25, deadline=None)
def test_a_point_is_paired_with_the_sound_image_that_its_normal_faces_most(seed, count):
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(count, 3)), unit(rng.normal(size=(count, 3)))
    images = points[:, None] + rng.normal(size=(count, 4, 3))
    images[:, 3] = points  # a point on the plane is its own image
    real, up = rng.uniform(size=(count, 4)) < 0.8, np.array([0.0, 0.0, 1.0])
    best, cosine = _best_images(points, normals, images, real, up, (0.3, 0.5, 2.0, 0.9))
    line = images - points[:, None]
    width = np.linalg.norm(line, axis=-1)
    facing = np.abs(np.einsum("nki,ni->nk", unit(line), normals))
    sound = real & (facing > 0.3) & (width > 0.5) & (width < 2.0)
    sound &= np.abs(unit(line) @ up) < 0.9
    facing = np.where(sound, facing, 0.0)
    none = np.where(sound.any(axis=1), facing.argmax(axis=1), -1)
    np.testing.assert_array_equal(best, none)
    np.testing.assert_allclose(cosine, facing.max(axis=1, initial=0.0))
