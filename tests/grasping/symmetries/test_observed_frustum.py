"""The space that the depth image leaves unobserved, where points may be real."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SensorConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum
from tests.geometry.tabletops import CAMERA, render

SENSOR = SensorConfig()
seeds = st.integers(0, 2**31)


def test_points_that_float_in_front_of_the_surface_are_rejected():
    depth, _ = render([])
    scene = SceneCloud(depth, CAMERA)
    on_table = scene.xyz[120, 160]
    points = np.stack([on_table, 0.8 * on_table, 1.2 * on_table, on_table - [0, 0, 0.003]])
    np.testing.assert_array_equal(in_observed_frustum(points, scene), [1, 0, 1, 1])


def test_points_outside_the_image_or_behind_the_camera_are_rejected():
    scene = SceneCloud(render([])[0], CAMERA)
    points = np.array([[2.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert not in_observed_frustum(points, scene).any()


def test_points_that_touch_the_lens_are_accepted():
    scene = SceneCloud(render([])[0], CAMERA)
    points = np.array([[0.0, 0.0, 1e-30]] * 2)
    assert in_observed_frustum(points, scene).shape == (2,)


def test_points_where_nothing_was_measured_may_be_real():
    scene = SceneCloud(np.zeros((240, 320)), CAMERA)
    assert in_observed_frustum(np.array([[0.0, 0.0, 0.5]]), scene).all()


@given(seeds, st.sampled_from([0.02, 0.6, 0.97]))
@settings(max_examples=25, deadline=None)
def test_the_nearest_pixel_around_a_point_decides(seed, unseen):
    rng = np.random.default_rng(seed)
    camera = Intrinsics(300.0, 300.0, 15.0, 11.0, 32, 24)
    depth = rng.uniform(0.45, 0.6, (24, 32)) * (rng.uniform(size=(24, 32)) > unseen)
    depth[:, :16] *= rng.integers(2)  # no depth at all about some points
    points = np.column_stack([rng.uniform(-0.03, 0.03, (80, 2)), rng.uniform(0.4, 0.6, 80)])
    points[::9, 2] *= -1.0
    found = in_observed_frustum(points, SceneCloud(depth, camera))
    pixels, inside = camera.pixels_of(points)
    radius = round(SENSOR.behind_tolerance * camera.fx / np.median(points[inside, 2]))
    assert radius > 1
    for (u, v), z, shown, real in zip(pixels, points[:, 2], inside, found, strict=True):
        window = depth[max(v - radius, 0) : v + radius + 1, max(u - radius, 0) : u + radius + 1]
        nearest = min(window[window > 0], default=0.0) if shown else np.inf
        assert real == (z > nearest - SENSOR.behind_tolerance - SENSOR.depth_noise * z**2)


def test_an_empty_set_of_points_is_accepted():
    scene = SceneCloud(render([])[0], CAMERA)
    assert in_observed_frustum(np.zeros((0, 3)), scene).shape == (0,)
