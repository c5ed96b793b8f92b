"""GG-CNN's maps: painted grasps can be read again."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.peers.grasp_maps import GraspMaps, peaks, scaled_rows
from pipelines.grasping.peers.rectangles import (
    angles,
    opening_pixels,
    rectangle_grasps,
    rectangle_rows,
)


def row(x: float, y: float, degrees: float, opening: float, score: float = 1.0) -> np.ndarray:
    each = np.array([opening]), np.array([0.5 * opening]), np.array([score])
    return rectangle_rows(np.array([[x, y]]), np.radians([degrees]), *each)


@pytest.mark.parametrize("degrees", [-88.0, -40.0, 0.0, 35.0, 89.0])
def test_a_painted_grasp_is_read_where_it_was(degrees):
    wanted = row(120.0, 160.0, degrees, 60.0)
    (found,) = GraspMaps.painted(wanted, (300, 300)).rectangles()
    assert_allclose(found[:2], [120.0, 160.0], atol=1.5)
    turn = np.degrees(angles(found[None]) - angles(wanted))[0]
    assert abs((turn + 90.0) % 180.0 - 90.0) < 2.0
    assert opening_pixels(found[None])[0] == pytest.approx(60.0, rel=0.03)


def test_maps_of_a_quarter_of_the_quality_give_the_same_grasp():
    wanted = row(120.0, 160.0, 50.0, 60.0)
    sure = GraspMaps.painted(wanted, (300, 300))
    mixed = GraspMaps(
        0.25 * sure.quality, 0.25 * sure.cos + 0.75, 0.25 * sure.sin, 0.25 * sure.width
    )
    (found,) = mixed.rectangles()
    assert np.degrees(angles(found[None]))[0] == pytest.approx(50.0, abs=2.0)
    assert opening_pixels(found[None])[0] == pytest.approx(60.0, rel=0.03)


def test_the_better_of_two_overlapping_grasps_is_painted():
    rows = np.concatenate([row(100, 100, 0.0, 90.0, 0.9), row(100, 100, 60.0, 30.0, 0.8)])
    maps = GraspMaps.painted(rows, (200, 200))
    assert maps.width[100, 100] == pytest.approx(0.6)
    assert maps.cos[100, 100] == pytest.approx(1.0)


def test_pixels_without_a_grasp_have_quality_0_and_angle_0():
    maps = GraspMaps.painted(row(100, 100, 60.0, 30.0), (200, 200))
    assert maps.quality[0, 0] == maps.width[0, 0] == maps.sin[0, 0] == 0.0
    assert maps.cos[0, 0] == 1.0


def test_no_peak_lies_within_20_pixels_of_a_better_one():
    quality = np.zeros((100, 100), np.float32)
    quality[50, 50], quality[60, 70], quality[50, 71], quality[5, 5] = 0.9, 0.8, 0.7, 0.05
    y, x = peaks(quality)
    assert list(zip(x.tolist(), y.tolist(), strict=True)) == [(50, 50)]
    quality[60, 70] = 0.0
    y, x = peaks(quality)
    assert list(zip(x.tolist(), y.tolist(), strict=True)) == [(50, 50), (71, 50)]


def test_a_bar_on_a_table_decodes_to_the_grasp_across_its_middle():
    """The worked example: 300 pixels, a bar of 4 cm by 12 cm, 3 cm high, turned by 30 degrees."""
    camera = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    middle, across = np.array([350.0, 200.0]), np.radians(30.0)
    axis = np.array([np.cos(across), -np.sin(across)])
    y, x = np.indices((480, 640))
    u, v = x - middle[0], y - middle[1]
    pixels = 0.57 / 600.0  # metres a pixel on top of the bar
    inside = (abs(u * axis[0] + v * axis[1]) * pixels < 0.02) & (
        abs(-u * axis[1] + v * axis[0]) * pixels < 0.06
    )
    depth = np.where(inside, 0.57, 0.6)
    label = rectangle_rows(
        middle[None], np.array([across]), np.array([0.064 / pixels]), np.array([30.0]), np.ones(1)
    )
    maps = GraspMaps.painted(scaled_rows(label, 300 / 480), (300, 400))
    rows = scaled_rows(maps.rectangles(), 480 / 300)
    gripper = load_gripper("rg2")
    grasps, _ = rectangle_grasps(rows, depth, camera, gripper)
    assert len(grasps) == 1
    lateral = (middle - [319.5, 239.5]) * pixels
    assert_allclose(grasps.translation[0], [*lateral, 0.57 + 0.015], atol=0.002)
    turn = abs(grasps.closing[0] @ [np.cos(across), -np.sin(across), 0.0])
    assert turn > np.cos(np.radians(3.0))
    assert_allclose(grasps.width, 0.064 - 2 * gripper.clearance, atol=0.003)
