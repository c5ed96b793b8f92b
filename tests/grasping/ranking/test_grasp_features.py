"""Features of grasps agree with their names, on a known box."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.transforms import random_rotation, transform_points, unit
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking import contact_patches, grasp_features
from pipelines.grasping.ranking.grasp_features import (
    CANDIDATE_FEATURES,
    NUM_POINTS,
    POINT_FEATURES,
    GraspFeatures,
    GraspPointFeature,
    grasp_frame,
)
from pipelines.grasping.ranking.region_context import RegionContext
from pipelines.grasping.scene import RegionCloud, SceneCloud
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render
from tests.grasping.seen_regions import believed

SIZE = (0.06, 0.09, 0.1)
NORMAL = slice(GraspPointFeature.NORMAL_APPROACH, GraspPointFeature.NORMAL_BINORMAL + 1)
KIND = slice(GraspPointFeature.IS_MEASURED, GraspPointFeature.IS_FOREIGN + 1)
BESIDE, HEIGHT = GraspPointFeature.BEYOND_CONTACT, GraspPointFeature.HEIGHT


def known_box():
    pose = looking_at_table()
    depth, index = render([Box(SIZE)], pose)
    scene = SceneCloud(depth, CAMERA, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))
    region = RegionCloud.from_mask(index == 0, scene)
    plane = ReflectionSymmetry(pose[:3, 1], transform_points(pose, [0, 0, 0.05]))
    foreign = transform_points(pose, [[0.0, 0.2, 0.0], [0.1, 0.2, 0.0]])
    return pose, RegionContext(
        region, scene, believed(plane), plane.counterpart(region.points), foreign
    )


POSE, KNOWN = known_box()


def hands(count=1, slot=0, height=0.08):
    """Hands from above, whose fingers close on the front and the hidden back of the box."""
    contacts = transform_points(POSE, [[0.0, -0.045, height], [0.0, 0.045, height]])
    grasps = GraspPoses.from_contacts([contacts] * count, np.tile(-POSE[:3, 2], (count, 1)))
    ones = np.ones(count)
    return RankedGrasps(
        grasps,
        0.8 * ones,
        np.full(count, slot),
        np.full(count, "network"),
        0.05 * ones,
        0.03 * ones,
        0.0 * ones,
    )


def views(found, known=KNOWN):
    return GraspFeatures(found, np.ones(len(found)), np.ones(len(found)), known)


def test_shapes_are_as_documented_for_any_number_of_hands():
    for count in (0, 1, 3):
        seen = views(hands(3)[np.arange(count)])
        assert seen.points().shape == (count, NUM_POINTS, len(POINT_FEATURES))
        assert seen.candidates().shape == (count, len(CANDIDATE_FEATURES))
        assert np.isfinite(seen.candidates()).all()


def test_each_block_of_features_has_as_many_columns_as_names_and_no_name_is_given_twice():
    seen = views(hands(3))
    for names, values in grasp_features.CANDIDATE_BLOCKS.items():
        assert np.column_stack([values(seen)]).shape == (3, len(names)), names
    assert len(set(CANDIDATE_FEATURES)) == len(CANDIDATE_FEATURES)


def test_points_around_the_fingers_have_their_kind_and_height():
    (rows,) = views(hands()).points()
    assert (np.abs(rows[:, BESIDE]) <= 2.5).all()
    assert (rows[:, KIND].sum(axis=1) == 1).all()
    assert rows[:, KIND].sum(axis=0)[0] > 5  # kind: measured
    assert rows[:, KIND].sum(axis=0)[1] > 5  # kind: image under the plane
    assert rows[:, KIND].sum(axis=0)[2] == 0  # other objects are farther away
    measured = rows[:, KIND][:, 0] == 1
    np.testing.assert_allclose(np.linalg.norm(rows[measured, NORMAL], axis=1), 1.0, atol=1e-3)
    np.testing.assert_array_equal(rows[~measured, NORMAL], 0.0)
    # The approach is straight down: points farther along it are lower by as much.
    np.testing.assert_allclose(rows[:, HEIGHT] / 10, 0.08 - rows[:, 0] / 20, atol=2e-3)
    front = measured & (rows[:, NORMAL][:, 1] < -0.9)
    np.testing.assert_allclose(rows[front, BESIDE], 0.0, atol=50 * 0.003)


def test_numbers_hold_width_pose_symmetry_and_the_seen_surface_at_each_contact():
    of = named(hands())
    assert abs(of["width"] - 0.9) < 1e-6
    up = [of[f"up_{axis}"] for axis in ("approach", "closing", "binormal")]
    np.testing.assert_allclose(up, [-1.0, 0.0, 0.0], atol=1e-6)
    assert of["confidence"] == of["confidence_0"] == 1.0
    assert (of["is_reflection"], of["is_planar"]) == (1.0, 0.0)
    assert abs(of["height"] - 0.8) < 0.02
    assert of["first_alignment_6mm"] > 0.95  # the front faces its finger
    assert of["first_distance"] < 30 * 0.006  # and the camera sees the touched surface
    assert of["second_distance"] > 30 * 0.006  # the back is not seen
    none = named(hands(slot=-1))
    assert (none["confidence"], none["is_reflection"], none["is_planar"]) == (0.0, 0.0, 1.0)


def test_numbers_hold_where_the_region_lies_and_how_far_it_extends_in_the_hands_frame():
    grasps, points = hands().grasps, KNOWN.region.points
    middle = (np.median(points, axis=0) - grasps.translation[0]) @ grasps.rotation[0]
    local = (points - grasps.translation[0]) @ grasps.rotation[0]
    expected = {"middle": middle, "mean": local.mean(axis=0) - middle, "spread": local.std(axis=0)}
    of = named(hands())
    for name, values in expected.items():  # in half decimetres
        found = [of[f"{name}_{axis}"] for axis in ("approach", "closing", "binormal")]
        np.testing.assert_allclose(found, 20.0 * values, atol=1e-5)


def named(found):
    """Return the features of one grasp by name."""
    (row,) = views(found).candidates()
    return dict(zip(CANDIDATE_FEATURES, row, strict=True))


def test_points_in_the_hands_frame_map_back_to_the_camera_frame():
    grasps = hands(2).grasps
    for index, local in enumerate(grasp_frame(KNOWN.region.points, grasps)):
        back = local.T @ grasps.rotation[index].T + grasps.translation[index]
        np.testing.assert_allclose(back, KNOWN.region.points, atol=1e-6)


@pytest.mark.parametrize("turn", [0.5, 2.0])
def test_features_do_not_depend_on_the_cameras_angle_about_the_vertical(turn):
    """Only the features of the direction of view may depend on it."""
    spin = np.eye(4)
    spin[:3, :3] = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    region = KNOWN.region
    moved = RegionCloud(
        transform_points(spin, region.points), region.normals @ spin[:3, :3].T, region.mask
    )
    plane = KNOWN.scene.plane
    scene = replace(KNOWN.scene, plane=Plane(spin[:3, :3] @ plane.normal, plane.offset))
    other = RegionContext(
        moved,
        scene,
        KNOWN.symmetries,
        np.zeros((0, 3)),  # a point and its image would be equally near
        transform_points(spin, KNOWN.foreign),
    )
    found = hands(2)
    there = replace(found, grasps=found.grasps.transformed(spin))
    bare = replace(KNOWN, hidden=np.zeros((0, 3)))
    here, over = views(found, bare).points(), views(there, other).points()
    for first, second in zip(here, over, strict=True):
        away, _ = KDTree(second).query(first)
        assert np.mean(away < 1e-3) > 0.5  # of a face's points, equally near, any may be left out


def test_without_a_table_heights_are_zero_and_few_points_are_repeated():
    scene = replace(KNOWN.scene, plane=None)
    few = replace(KNOWN.region, points=KNOWN.region.points[:9], normals=KNOWN.region.normals[:9])
    bare = RegionContext(few, scene, believed(), np.zeros((0, 3)), np.zeros((0, 3)))
    seen = views(hands(slot=-1), bare)
    (rows,) = seen.points()
    assert len(np.unique(rows, axis=0)) <= 9
    np.testing.assert_array_equal(rows[:, HEIGHT], 0.0)
    assert np.isfinite(seen.candidates()).all()


@given(st.integers(0, 2**31), st.integers(0, 5), st.sampled_from([1, 40, 64, 65, 200]))
@settings(max_examples=25, deadline=None)
def test_rows_hold_the_points_nearest_to_the_space_between_the_fingers(seed, count, size):
    rng = np.random.default_rng(seed)
    local = rng.normal(0.0, 0.05, (count, 3, size)).astype(np.float32)
    half = rng.uniform(0.0, 0.05, count).astype(np.float32)
    starts = np.sort(rng.integers(0, size + 1, 3))
    away, between = grasp_features._between_fingers(local, half, starts)
    along, across, third = local.swapaxes(0, 1)
    beside = np.abs(across) - half[:, None]
    expected = np.maximum(np.maximum(np.abs(along) / 1.5, np.abs(third)), beside)
    np.testing.assert_allclose(away, expected, rtol=1e-6)
    inside = (np.abs(third) < grasp_features.FINGER_BAND) & (beside < grasp_features.BESIDE)
    inside &= (along < grasp_features.BEYOND) & (along > grasp_features.BEHIND)
    for kind in range(2):
        span = slice(starts[kind], starts[kind + 1])
        np.testing.assert_array_equal(between[:, kind], inside[:, span].sum(axis=1))

    away = np.round(away, 2)  # many are equally far away
    rotation = np.stack([np.eye(3), *(random_rotation(rng) for _ in range(count))])[1:]
    about = rng.normal(size=(size, 7)).astype(np.float32)
    reach = np.sort(away, axis=1)[:, min(NUM_POINTS, size) - 1].copy()
    rows = grasp_features._nearest_rows(
        local, rotation.astype(np.float32), half, away, reach, about
    )
    assert rows.shape == (count, NUM_POINTS, len(POINT_FEATURES))
    for k in range(count):
        chosen = np.sort(np.argsort(away[k], kind="stable")[:NUM_POINTS])
        chosen = np.resize(chosen, NUM_POINTS)
        wanted = [
            20.0 * np.clip(local[k][:, chosen].T, -0.15, 0.15),
            50.0 * np.clip(beside[k, chosen], -0.05, 0.05)[:, None],
            about[chosen, :3] @ rotation[k],
            about[chosen, 3:],
        ]
        np.testing.assert_allclose(rows[k], np.concatenate(wanted, axis=1), rtol=1e-4, atol=1e-5)


@given(st.integers(0, 2**31), st.integers(0, 6), st.integers(1, 300))
@settings(max_examples=25, deadline=None)
def test_the_seen_surface_around_a_contact_equals_that_of_numpy_arrays(seed, count, size):
    rng = np.random.default_rng(seed)
    points, normals = rng.uniform(-0.02, 0.02, (size, 3)), unit(rng.normal(size=(size, 3)))
    contacts = rng.uniform(-0.04, 0.04, (2, 2, 3))[rng.integers(2, size=(count, 2)), [0, 1]]
    closing = unit(contacts[:, 1] - contacts[:, 0])
    found = contact_patches._patches(contacts, closing, np.ascontiguousarray(points.T), normals)
    assert found.shape == (count, 16)
    for k in range(count):
        for finger, side in enumerate((-1.0, 1.0)):
            away = np.linalg.norm(points - contacts[k, finger], axis=1)
            facing = side * normals @ closing[k]
            expected = []
            for radius in contact_patches.RADII:
                near = facing[away < radius]
                few = len(near) if len(near) else 1
                mean = near.sum() / few
                spread = np.sqrt(np.square(near - mean).sum() / few)
                expected += [mean, spread, min(len(near), 30) / 30.0]
            nearest = away.argmin()
            expected.append(30.0 * min(away[nearest], 0.03))
            expected.append(facing[nearest] * (away[nearest] < contact_patches.CONTACT_REACH))
            part = found[k, 8 * finger : 8 * finger + 8]
            np.testing.assert_allclose(part, expected, atol=1e-12)


def test_the_numbers_of_a_hand_do_not_depend_on_the_other_hands():
    low, high = hands(height=0.05), hands(height=0.08)
    parts = [low.grasps, low.grasps, high.grasps, low.grasps]
    found = replace(hands(4), grasps=GraspPoses.concatenate(parts))
    rows, alone = views(found).candidates(), [views(hand).candidates()[0] for hand in (low, high)]
    np.testing.assert_allclose(rows, [alone[0], alone[0], alone[1], alone[0]], atol=1e-6)
