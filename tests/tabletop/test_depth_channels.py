"""Channels of a depth image of known geometry."""

import cv2
import numpy as np

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.depth_channels import (
    CHANNEL_NAMES,
    FIT_RADIUS,
    HEIGHT_UNIT,
    LIMIT,
    STEP_UNIT,
    SmallFrame,
    depth_channels,
    height_plane,
    shrink,
)
from pipelines.tabletop.organized import smooth_normals
from pipelines.tabletop.sparse_depth import nearest_measured

CAMERA = Intrinsics(200.0, 200.0, 95.5, 71.5, 192, 144)
TABLE = Plane(np.array([0.0, -0.6, -0.8]), 0.6)


def table_with_slab():
    rays = CAMERA.rays()
    depth = -TABLE.offset / (rays @ TABLE.normal)
    slab = np.zeros(depth.shape, bool)
    slab[50:90, 60:110] = True
    depth[slab] = ((TABLE.offset - HEIGHT_UNIT) / -(rays @ TABLE.normal))[slab]
    return depth.astype(np.float32), slab


def test_channels_hold_the_height_over_the_table_and_the_tilt_of_surfaces():
    depth, slab = table_with_slab()
    channels = dict(zip(CHANNEL_NAMES, depth_channels(depth, CAMERA, TABLE), strict=True))
    inner = np.zeros_like(slab)
    inner[56:84, 66:104] = True
    np.testing.assert_allclose(channels["height"][inner], 1.0, atol=0.02)
    np.testing.assert_allclose(channels["upright"][inner], 1.0, atol=0.02)
    assert np.abs(channels["height"][~slab]).max() < 0.2
    assert not channels["missing"].any()


def test_missing_depth_is_filled_and_marked():
    depth, _ = table_with_slab()
    depth[60:70, 70:80] = 0.0
    channels = depth_channels(depth, CAMERA, TABLE)
    assert np.isfinite(channels).all()
    assert channels[-1].sum() == 100
    assert np.abs(channels[3][60:70, 70:80] - 1.0).max() < 0.2


def test_channels_equal_those_of_numpy_arrays():
    depth, _ = table_with_slab()
    rng = np.random.default_rng(0)
    depth += rng.normal(0, 0.002, depth.shape).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = 0.0
    missing = depth == 0
    filled = nearest_measured(np.where(missing, np.float32(0.0), cv2.medianBlur(depth, 3)), 3)
    xyz = CAMERA.backproject(filled)
    normals = np.nan_to_num(smooth_normals(xyz, ~np.zeros_like(missing), FIT_RADIUS))
    height = np.clip(TABLE.height(xyz) / HEIGHT_UNIT, -LIMIT, LIMIT)
    step = np.clip((filled - cv2.blur(filled, (5, 5))) / STEP_UNIT, -LIMIT, LIMIT)
    stretched = np.copysign(np.sqrt(np.abs(height)), height)
    upright = normals @ TABLE.normal
    expected = np.stack([normals[..., 0], normals[..., 1], upright, stretched, step, missing])
    np.testing.assert_allclose(depth_channels(depth, CAMERA, TABLE), expected, atol=1e-6)


def test_single_pixels_of_depth_make_no_surface():
    depth = np.zeros((144, 192), np.float32)
    depth[::40, ::40] = 0.7  # the median of their surroundings removes them
    channels = depth_channels(depth, CAMERA, TABLE)
    assert np.isfinite(channels).all()
    assert not channels[:3].any()


def test_a_frame_without_depth_is_all_missing():
    channels = depth_channels(np.zeros((144, 192), np.float32), CAMERA, TABLE)
    assert (channels[-1] == 1.0).all()
    assert not channels[:-1].any()


def test_holes_take_the_value_of_the_nearest_pixel():
    depth = np.zeros((5, 9), np.float32)
    depth[:, 0], depth[:, 8] = 1.0, 2.0
    assert nearest_measured(depth, 3)[2, [0, 1, 2, 3, 5, 6, 7, 8]].tolist() == 4 * [1] + 4 * [2]


def test_the_plane_found_is_the_table():
    depth, _ = table_with_slab()
    plane = height_plane(SmallFrame(np.zeros((144, 192, 3), np.uint8), depth, CAMERA))
    assert plane.normal @ TABLE.normal > 0.999
    assert abs(plane.offset - TABLE.offset) < 0.005


def test_shrinking_keeps_the_places_of_points():
    depth, _ = table_with_slab()
    small = shrink(np.zeros((144, 192, 3), np.uint8), depth, CAMERA, 72, 128)
    assert small.depth.shape == (72, 96)
    heights = TABLE.height(small.intrinsics.backproject(small.depth))
    assert abs(np.median(heights)) < 0.003


def test_a_frame_without_colour_shrinks_to_the_same_size():
    depth = np.random.default_rng(0).uniform(0.5, 0.9, (144, 192)).astype(np.float32)
    color = np.full((144, 192, 3), 7, np.uint8)
    seen, unseen = (shrink(each, depth, CAMERA, 72, 128) for each in (color, None))
    np.testing.assert_array_equal(seen.depth, unseen.depth)
    assert unseen.intrinsics == seen.intrinsics
    np.testing.assert_array_equal(seen.color, 7)
    np.testing.assert_array_equal(unseen.color, np.zeros_like(seen.color))
