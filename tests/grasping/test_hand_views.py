"""What a hand meets, as its judge sees it: each column says what it is called, on a known box."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ReflectionSymmetry, SymmetrySlots
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.candidates import RankedGrasps
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.hand_views import (
    HAND_FEATURES,
    NUM_POINTS,
    POINT_FEATURES,
    HandViews,
    KnownRegion,
    hand_frame,
)
from pipelines.grasping.observation import RegionCloud, SceneCloud
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render

SIZE = (0.06, 0.09, 0.1)
PLACE, BESIDE, NORMAL, KIND, HEIGHT = slice(0, 3), 3, slice(4, 7), slice(7, 10), 10
WIDTH, UP, SLOT_TRUST, IS_PLANE, IS_PLANAR, TIP_HEIGHT = 0, slice(1, 4), 11, 12, 15, 16
PATCHES = slice(19, 35)  # eight of the first contact, eight of the second


def known_box():
    pose = looking_at_table()
    depth, index = render([Box(SIZE)], pose)
    scene = SceneCloud(depth, CAMERA, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))
    region = RegionCloud.from_mask(index == 0, scene)
    plane = ReflectionSymmetry(pose[:3, 1], transform_points(pose, [0, 0, 0.05]))
    slots = SymmetrySlots.from_symmetries([plane])
    foreign = transform_points(pose, [[0.0, 0.2, 0.0], [0.1, 0.2, 0.0]])
    return pose, KnownRegion(region, scene, slots, plane.counterpart(region.points), foreign)


POSE, KNOWN = known_box()


def hands(count=1, slot=0, height=0.08):
    """Hands from above, whose fingers close on the front and the hidden back of the box."""
    contacts = transform_points(POSE, [[0.0, -0.045, height], [0.0, 0.045, height]])
    grasps = Grasps.from_contacts([contacts] * count, np.tile(-POSE[:3, 2], (count, 1)))
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
    return HandViews(found, np.ones(len(found)), np.ones(len(found)), known)


def test_shapes_are_as_documented_for_any_number_of_hands():
    for count in (0, 1, 3):
        seen = views(hands(3)[np.arange(count)])
        assert seen.point_rows().shape == (count, NUM_POINTS, POINT_FEATURES)
        assert seen.hand_rows().shape == (count, HAND_FEATURES)
        assert np.isfinite(seen.hand_rows()).all()


def test_points_are_those_about_the_fingers_with_their_kind_and_height():
    (rows,) = views(hands()).point_rows()
    assert (np.abs(rows[:, BESIDE]) <= 2.5).all()
    assert (rows[:, KIND].sum(axis=1) == 1).all()
    assert rows[:, KIND].sum(axis=0)[0] > 5  # measured
    assert rows[:, KIND].sum(axis=0)[1] > 5  # put there by the plane
    assert rows[:, KIND].sum(axis=0)[2] == 0  # other things are farther away
    measured = rows[:, KIND][:, 0] == 1
    np.testing.assert_allclose(np.linalg.norm(rows[measured, NORMAL], axis=1), 1.0, atol=1e-3)
    np.testing.assert_array_equal(rows[~measured, NORMAL], 0.0)
    # The approach is straight down: what lies farther along it lies lower by as much.
    np.testing.assert_allclose(rows[:, HEIGHT] / 10, 0.08 - rows[:, 0] / 20, atol=2e-3)
    front = measured & (rows[:, NORMAL][:, 1] < -0.9)
    np.testing.assert_allclose(rows[front, BESIDE], 0.0, atol=50 * 0.003)


def test_numbers_tell_width_pose_symmetry_and_what_is_seen_at_each_contact():
    (row,) = views(hands()).hand_rows()
    assert abs(row[WIDTH] - 0.9) < 1e-6
    np.testing.assert_allclose(row[UP], [-1.0, 0.0, 0.0], atol=1e-6)
    assert row[SLOT_TRUST] == 1.0
    assert (row[IS_PLANE], row[IS_PLANAR]) == (1.0, 0.0)
    assert abs(row[TIP_HEIGHT] - 0.8) < 0.02
    first, second = row[PATCHES].reshape(2, 8)
    assert first[0] > 0.95  # the front faces its finger
    assert first[6] < 30 * 0.006  # and is seen where the finger touches
    assert second[6] > 30 * 0.006  # the back is not
    (none,) = views(hands(slot=-1)).hand_rows()
    assert (none[SLOT_TRUST], none[IS_PLANE], none[IS_PLANAR]) == (0.0, 0.0, 1.0)


def test_the_hands_frame_leads_back_to_the_cameras():
    grasps = hands(2).grasps
    for index, local in enumerate(hand_frame(KNOWN.region.points, grasps)):
        back = local @ grasps.rotation[index].T + grasps.translation[index]
        np.testing.assert_allclose(back, KNOWN.region.points, atol=1e-6)


@pytest.mark.parametrize("turn", [0.5, 2.0])
def test_nothing_depends_on_where_the_camera_stands_about_the_vertical(turn):
    """Only the direction of view, which is no number of points, may tell."""
    spin = np.eye(4)
    spin[:3, :3] = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    region = KNOWN.region
    moved = RegionCloud(
        transform_points(spin, region.points), region.normals @ spin[:3, :3].T, region.mask
    )
    plane = KNOWN.scene.plane
    scene = replace(KNOWN.scene, plane=Plane(spin[:3, :3] @ plane.normal, plane.offset))
    other = KnownRegion(
        moved,
        scene,
        KNOWN.slots,
        np.zeros((0, 3)),  # a point and its image would be equally near
        transform_points(spin, KNOWN.foreign),
    )
    found = hands(2)
    there = replace(found, grasps=found.grasps.transformed(spin))
    bare = replace(KNOWN, hidden=np.zeros((0, 3)))
    here, over = views(found, bare).point_rows(), views(there, other).point_rows()
    for first, second in zip(here, over, strict=True):
        away, _ = KDTree(second).query(first)
        assert np.mean(away < 1e-3) > 0.5  # of a face's points, equally near, any may be left out


def test_without_a_table_heights_are_zero_and_few_points_are_repeated():
    scene = replace(KNOWN.scene, plane=None)
    few = replace(KNOWN.region, points=KNOWN.region.points[:9], normals=KNOWN.region.normals[:9])
    bare = KnownRegion(few, scene, SymmetrySlots.empty(), np.zeros((0, 3)), np.zeros((0, 3)))
    seen = views(hands(slot=-1), bare)
    (rows,) = seen.point_rows()
    assert len(np.unique(rows, axis=0)) <= 9
    np.testing.assert_array_equal(rows[:, HEIGHT], 0.0)
    assert np.isfinite(seen.hand_rows()).all()
