"""Workspace and approach cone: the allowed grasps, in each frame."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import LimitsConfig
from pipelines.errors import UnknownNameError, ValueRangeError
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import random_rotation, transform_points
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.limits import Limits, check_limits
from tests.geometry.tabletops import CAMERA, looking_at_table

POSE = looking_at_table()
TABLE = Plane(POSE[:3, 2], float(-POSE[:3, 2] @ POSE[:3, 3]))
seeds = st.integers(0, 2**31)


def limits(mask=None, plane=TABLE, **settings):
    return Limits.of(LimitsConfig(**settings), mask, plane, CAMERA)


def random_grasps(rng, count=30):
    rotation = np.stack([random_rotation(rng) for _ in range(count)])
    where = rng.uniform([-0.3, -0.2, 0.4], [0.3, 0.2, 1.0], (count, 3))
    return GraspPoses(rotation, where, np.full(count, 0.05))


def test_without_settings_there_is_no_limit():
    assert limits() is None


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_a_box_contains_the_points_in_it(seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform([-0.3, -0.2, 0.4], [0.1, 0.1, 0.6])
    high = low + rng.uniform(0.05, 0.5, 3)
    grasps = random_grasps(rng)
    expected = [all(low <= t) and all(t <= high) for t in grasps.translation]
    assert limits(box=(*low, *high)).allow(grasps).tolist() == expected


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_a_box_over_the_table_is_the_same_wherever_the_camera_stands(seed):
    rng = np.random.default_rng(seed)
    box = (-0.1, 0.2, 0.01, 0.1, 0.6, 0.2)
    pose = looking_at_table(rng.uniform(0.5, 0.9), rng.uniform(0.4, 1.3))
    plane = Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3]))
    eye = np.linalg.inv(pose)[:3, 3]  # the camera is above the table's origin
    inside = rng.uniform(box[:3], box[3:], (20, 3)) + eye * [1, 1, 0]
    outside = inside + np.array([0, 0, 0.25])
    found = limits(plane=plane, box=box, box_frame="table")
    assert found.contain(transform_points(pose, inside)).all()
    assert not found.contain(transform_points(pose, outside)).any()


def test_a_mask_contains_the_points_seen_in_its_pixels():
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[100:140, 200:240] = True
    found = limits(mask)
    pixels = np.array([[220, 120], [199, 120], [220, 141], [-5, 120], [220, 500]])
    rays = np.column_stack([(pixels - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones(5)])
    assert found.contain(0.7 * rays).tolist() == [True, False, False, False, False]
    assert not found.contain(-0.7 * rays).any()  # behind the camera


@given(seeds, st.floats(1.0, 179.0))
@settings(max_examples=20, deadline=None)
def test_the_cone_is_about_its_direction_in_its_frame(seed, degrees):
    grasps = random_grasps(np.random.default_rng(seed))
    for frame, axis in (("table", -TABLE.normal), ("camera", np.array([0.0, 0.0, -1.0]))):
        angle = np.degrees(np.arccos(np.clip(grasps.approach @ axis, -1, 1)))
        found = limits(approach_cone=degrees, approach_frame=frame).allow(grasps)
        clear = np.abs(angle - degrees) > 1e-4
        np.testing.assert_array_equal(found[clear], (angle < degrees)[clear])


@pytest.mark.parametrize(
    "settings", [{"box": (0, 0, 0, 1, 1, 1), "box_frame": "table"}, {"approach_cone": 30.0}]
)
def test_the_tables_frame_needs_a_table(settings):
    with pytest.raises(ValueRangeError, match="table"):
        limits(plane=None, **settings)


@pytest.mark.parametrize(
    "settings",
    [
        {"box": (0, 0, 0, 1, 1)},
        {"box": (0, 0, 0, 1, 1, -1)},
        {"box": (0, 0, 0, 1, 1, np.nan)},
        {"approach_direction": (0.0, 0.0, 0.0)},
        {"approach_direction": (0.0, 1.0)},
        {"approach_cone": 0.0},
        {"approach_cone": 181.0},
        {"approach_cone": np.nan},
    ],
)
def test_impossible_limits_are_refused(settings):
    with pytest.raises(ValueRangeError, match=next(iter(settings))):
        check_limits(LimitsConfig(**settings))


def test_a_workspace_in_millimetres_is_refused():
    with pytest.raises(ValueRangeError, match="within 50 m; divide millimetres by 1000"):
        check_limits(LimitsConfig(box=(-300.0, -200.0, 0.0, 300.0, 200.0, 900.0)))
    check_limits(LimitsConfig(box=(-50.0, -50.0, -50.0, 50.0, 50.0, 50.0)))


@pytest.mark.parametrize("settings", [{"box_frame": "base"}, {"approach_frame": "base"}])
def test_unknown_frames_are_refused(settings):
    with pytest.raises(UnknownNameError, match="camera, table"):
        check_limits(LimitsConfig(**settings))
    check_limits(LimitsConfig(box=(0, 0, 0, 1, 1, 1)))
