"""Grasp rectangles, and the poses that they stand for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.peers.rectangles import (
    angles,
    corners,
    hold_at,
    on_their_object,
    opening_pixels,
    rectangle_grasps,
    rectangle_rows,
)

CAMERA = Intrinsics(300.0, 310.0, 159.5, 119.5, 320, 240)
RG2 = load_gripper("rg2")
PLANE = np.full((240, 320), 0.6)


def some_rows(*degrees: float) -> np.ndarray:
    count = len(degrees)
    center = np.array([[100.0, 90.0]] * count)
    return rectangle_rows(
        center, np.radians(degrees), np.full(count, 30.0), np.full(count, 12.0), np.ones(count)
    )


def test_a_rectangle_on_a_plane_projects_back_to_its_centre_and_opening():
    rows = some_rows(-70.0, 0.0, 25.0, 89.0)
    grasps, index = rectangle_grasps(rows, PLANE, CAMERA, RG2)
    assert index.tolist() == [0, 1, 2, 3]
    surface = grasps.translation - (0.02 - RG2.tip_reach) * grasps.approach
    opening = grasps.width + 2 * RG2.clearance
    ends = [surface + sign * 0.5 * opening[:, None] * grasps.closing for sign in (0.0, 1.0)]
    center, side = (CAMERA.project(points) for points in ends)
    assert_allclose(center, rows[:, :2], atol=1e-3)
    assert_allclose(2 * np.linalg.norm(side - center, axis=1), opening_pixels(rows), atol=1e-3)


@pytest.mark.parametrize("largest", [0.1, 0.2, 0.3, 0.4, 0.9])
def test_labels_hold_up_to_a_friction_whatever_the_rounding_of_their_scores(largest):
    friction = np.arange(1, 11) / 10
    rows = some_rows(*np.zeros(len(friction)))
    rows[:, 5] = (1.1 - friction).astype(np.float32)
    assert friction[hold_at(rows, largest)].tolist() == friction[friction <= largest].tolist()


def test_finger_tips_end_2_cm_behind_the_surface_along_the_view():
    grasps, _ = rectangle_grasps(some_rows(0.0), PLANE, CAMERA, RG2)
    assert_allclose(grasps.approach, [[0.0, 0.0, 1.0]])
    assert_allclose(grasps.translation[0, 2] + RG2.tip_reach, 0.62)


def test_an_opening_beyond_the_grippers_is_cut_to_its_widest():
    rows = some_rows(0.0)
    rows[:, 2] += 100.0
    grasps, _ = rectangle_grasps(rows, PLANE, CAMERA, RG2)
    assert_allclose(grasps.width, RG2.max_opening - 2 * RG2.clearance)


def test_a_rectangle_without_depth_at_its_centre_or_outside_has_no_grasp():
    depth = PLANE.copy()
    depth[90, 100] = 0.0
    outside = some_rows(0.0) + np.array([500.0, 0, 500.0, 0, 0, 0, 0])
    grasps, index = rectangle_grasps(np.concatenate([some_rows(0.0), outside]), depth, CAMERA, RG2)
    assert len(grasps) == len(index) == 0


@pytest.mark.parametrize("degrees", [-90.0, -45.0, 0.0, 60.0])
def test_angles_are_counter_clockwise_on_the_screen(degrees):
    (angle,) = angles(some_rows(degrees))
    assert np.degrees(angle) == pytest.approx(degrees)


def test_an_angle_and_the_opposite_one_are_the_same():
    assert_allclose(angles(some_rows(30.0)), angles(some_rows(210.0)), atol=1e-9)


def test_the_middle_third_of_a_rectangle_has_its_whole_height():
    (shown,) = corners(some_rows(0.0), 1.0 / 3.0)
    assert_allclose(np.ptp(shown, axis=0), [10.0, 12.0])
    assert_allclose(shown.mean(axis=0), [100.0, 90.0])


def test_rows_whose_object_is_hidden_at_the_centre_are_found():
    rows = np.repeat(some_rows(0.0), 3, axis=0)
    rows[:, 6] = [4, 5, 4]
    rows[2, 0] = -3.0
    label = np.zeros((240, 320), np.uint8)
    label[90, 100] = 5
    assert on_their_object(rows, label).tolist() == [True, False, False]
