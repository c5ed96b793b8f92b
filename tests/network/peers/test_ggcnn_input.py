"""Input of GG-CNN: no background shifts its mean."""

import numpy as np
import pytest

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.network.peers.ggcnn_input import BEHIND, BELOW, whole_depth

CAMERA = Intrinsics(fx=60.0, fy=60.0, cx=32.0, cy=24.0, width=64, height=48)
LEVEL = Plane(np.array([0.0, -1.0, 0.0]), 0.5)  # the camera looks level, 0.5 m above the table


def level_table(end):
    """Depth (48, 64) of a table that ends `end` metres ahead, 0 elsewhere."""
    below = (np.arange(48) - CAMERA.cy) / CAMERA.fy
    depth = np.zeros((48, 64), np.float32)
    depth[below > 0] = (0.5 / below[below > 0])[:, None]
    return np.where(depth < end, depth, 0).astype(np.float32)


@pytest.mark.parametrize("background", [3.0, 30.0])
def test_a_background_above_the_horizon_is_no_farther_than_the_end_of_the_table(background):
    table = level_table(2.0)
    depth = np.where(table > 0, table, np.float32(background))
    whole = whole_depth(depth, CAMERA, LEVEL)
    np.testing.assert_allclose(whole[table > 0], table[table > 0], atol=1e-5)
    assert whole.max() == pytest.approx(table.max() + BEHIND, abs=1e-5)


def test_a_floor_moves_to_just_below_the_table():
    plane = Plane(np.array([0.0, 0.0, -1.0]), 1.0)  # the camera looks down from 1 m
    depth = np.full((48, 64), 1.0, np.float32)
    depth[:, 40:] = 1.7
    whole = whole_depth(depth, CAMERA, plane)
    np.testing.assert_allclose(whole[:, :40], 1.0)
    np.testing.assert_allclose(whole[:, 40:], 1.0 + BELOW, atol=1e-6)


def test_missing_pixels_have_the_depth_of_their_neighbors():
    depth = np.full((48, 64), 1.0, np.float32)
    depth[10:20, 10:20] = 0
    np.testing.assert_allclose(whole_depth(depth, CAMERA, None), 1.0)
    np.testing.assert_allclose(whole_depth(np.zeros_like(depth), CAMERA, None), 1.0)
