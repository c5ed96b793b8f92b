"""Contact pairs of graspable points and their counterparts."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SelectionConfig
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import invert, transform_points, unit
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.candidates.candidates import (
    _best_images,
    symmetric_candidates,
)
from pipelines.grasping.feasibility.feasibility import Feasibility
from tests.geometry.tabletops import Box, Can
from tests.grasping.seen_regions import believed, box_planes, seen

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")
seeds = st.integers(0, 2**31)


def pairs_of(region, scene, symmetries, gripper=GRIPPER, affordance=1.0):
    checks = Feasibility.at(region, scene, gripper, CONFIG.feasibility, 0.05)
    found = symmetries.between(0.5)
    return symmetric_candidates(
        region, found, np.full(len(region), affordance), CONFIG.candidates, checks
    )


def box_seen():
    pose, scene, region = seen([Box((0.06, 0.09, 0.1))])
    return pose, scene, region, box_planes(pose, 0.1)


def widths(pairs):
    return np.linalg.norm(pairs.contacts[:, 1] - pairs.contacts[:, 0], axis=1)


def test_counterparts_lie_across_the_box():
    _, scene, region, planes = box_seen()
    pairs = pairs_of(region, scene, planes)
    assert len(pairs) > 5
    facing = (pairs.slot == 1) & (pairs.stability > 0.9)  # the first contact lies on a side
    np.testing.assert_allclose(widths(pairs)[facing], 0.09, atol=0.004)


def test_each_point_takes_the_plane_whose_normal_is_along_its_own():
    pose, scene, region, planes = box_seen()
    pairs = pairs_of(region, scene, planes)
    line = unit(pairs.contacts[:, 1] - pairs.contacts[:, 0])
    across = np.abs(line @ pose[:3, :2])  # cosines to the two planes' normals
    np.testing.assert_array_equal(across.argmax(axis=1), pairs.slot)


def test_points_of_low_affordance_are_in_no_pair():
    _, scene, region, planes = box_seen()
    assert len(pairs_of(region, scene, planes, affordance=0.5)) == 0


def test_a_false_symmetry_gives_no_pairs_in_free_space():
    pose, scene, region, _ = box_seen()
    # Mirroring the front face in a plane in front of it puts counterparts into the air.
    before = ReflectionSymmetry(pose[:3, 1], transform_points(pose, [0, -0.075, 0.05]))
    pairs = pairs_of(region, scene, believed(before))
    height = transform_points(invert(pose), pairs.contacts[:, 1])[:, 2]
    assert (height < 0.025).all()  # the other counterparts are on the table, to within noise
    mirrored = before.counterpart(region.points)
    assert (transform_points(invert(pose), mirrored)[:, 2] > 0.025).mean() > 0.5


def test_pairs_across_an_axis_are_as_wide_as_the_can():
    pose, scene, region = seen([Can(0.035, 0.12)])
    axis = RotationSymmetry(pose[:3, 2], transform_points(pose, [0, 0, 0]))
    pairs = pairs_of(region, scene, believed(axis))
    assert len(pairs) > 5
    np.testing.assert_allclose(widths(pairs), 0.07, atol=0.004)


def test_pairs_wider_than_the_gripper_are_left_out():
    _, scene, region, planes = box_seen()
    narrow = replace(GRIPPER, max_opening=0.08)
    all_pairs, left = (pairs_of(region, scene, planes, each) for each in (GRIPPER, narrow))
    assert widths(left).max() < narrow.max_width < widths(all_pairs).max()


@given(seeds, st.integers(0, 30))
@settings(max_examples=25, deadline=None)
def test_a_point_is_paired_with_the_possible_image_that_its_normal_opposes_most(seed, count):
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(count, 3)), unit(rng.normal(size=(count, 3)))
    images = points[:, None] + rng.normal(size=(count, 4, 3))
    images[:, 3] = points  # a point on the plane is its own image
    real = rng.uniform(size=(count, 4)) < 0.8
    best, cosine = _best_images(points, normals, images, real, (0.5, 2.0))
    line = images - points[:, None]
    width = np.linalg.norm(line, axis=-1)
    facing = np.abs(np.einsum("nki,ni->nk", unit(line), normals))
    sound = real & (width > 0.5) & (width < 2.0)
    facing = np.where(sound, facing, 0.0)
    none = np.where(sound.any(axis=1), facing.argmax(axis=1), -1)
    np.testing.assert_array_equal(best, none)
    np.testing.assert_allclose(cosine, facing.max(axis=1, initial=0.0))
