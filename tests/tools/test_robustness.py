"""Points of the robustness curves, and their comparison on common objects."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from pipelines.configs import EvaluateConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.evaluation.truth import TruthReader
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.synthesis.scenes.tables import View
from tests.stages.toy_root import SHAPES, write_root
from tools.robustness import compared_cells, write_point
from tools.robustness_points import CURVE_POINTS, Point, noisier, without_pixels

SMALL = Point(size=(160, 120))
TARGET = np.array([0.1, -0.2, 0.03])


@pytest.fixture
def view():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 0.7, (60, 80))
    depth[:5] = 0.0
    color = rng.integers(0, 256, (60, 80, 3)).astype(np.uint8)
    index = np.where(np.arange(80) < 40, -1, 0) * np.ones((60, 1), int)
    return View(color, depth, index, np.eye(4))


@pytest.mark.parametrize("name", [name for name in CURVE_POINTS if CURVE_POINTS[name].edit is None])
def test_every_camera_looks_at_the_target_from_its_distance_and_elevation(name):
    point = CURVE_POINTS[name]
    pose = point.pose(TARGET, 0.7)
    seen = np.linalg.inv(pose) @ [*TARGET, 1.0]
    np.testing.assert_allclose(seen[:3], [0.0, 0.0, point.distance], atol=1e-9)
    np.testing.assert_allclose(-pose[2, 2], np.sin(np.radians(point.elevation)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(pose[:3, :3]), 1.0)


def test_the_camera_is_upright_without_roll_and_upside_down_with_180_degrees():
    upright, turned = (Point(roll=roll).pose(TARGET, 0.7) for roll in (0, 180))
    assert upright[2, 1] < 0.0 < turned[2, 1]  # z of the image's downward axis


def test_an_object_counts_from_the_same_seen_area():
    assert Point().min_visible_pixels == 300
    assert Point(distance=1.3).min_visible_pixels == 75
    assert Point(size=(320, 240)).min_visible_pixels == 75


@pytest.mark.parametrize(
    "name", [name for name in CURVE_POINTS if CURVE_POINTS[name].edit is not None]
)
def test_an_edit_changes_either_colour_or_depth_and_invents_no_depth(name, view):
    color, depth = CURVE_POINTS[name].edit(view, np.random.default_rng(1))
    assert color.dtype == np.uint8
    assert color.shape == view.color.shape
    assert np.array_equal(color, view.color) != np.array_equal(depth, view.depth)
    assert not depth[view.depth == 0].any()


def test_edits_of_depth_have_the_stated_size(view):
    rng = np.random.default_rng(1)
    flat = replace(view, depth=np.full((240, 320), 0.9))
    once, twice = (noisier(flat, rng, factor=factor)[1] for factor in (1.0, 2.0))
    np.testing.assert_array_equal(once, flat.depth)
    expected = np.sqrt(3.0) * (0.0006 + 0.0016 * 0.5**2)  # beyond the sensor's own noise
    np.testing.assert_allclose((twice - flat.depth).std(), expected, rtol=1e-6)
    missing = partial(without_pixels, share=0.3)(flat, rng)[1] == 0
    np.testing.assert_allclose(missing.mean(), 0.3, atol=0.01)


def test_a_point_holds_the_scenes_of_the_root_seen_by_its_camera(tmp_path):
    root, out = write_root(tmp_path / "root"), tmp_path / "point"
    write_point(root, replace(SMALL, elevation=90.0, distance=0.5), out)
    made = GraspNetRoot(out)
    assert [scene.scene_id for scene in made.scenes()] == [100, 160]
    for scene in made.scenes():
        (files,) = scene.frames()
        depth, camera = made.read_depth(files)
        truth = TruthReader(made, EvaluateConfig(min_visible_pixels=20)).read(files)
        assert (camera.width, camera.height) == SMALL.size
        assert truth.visible == list(SHAPES)
        np.testing.assert_allclose(depth[truth.label == 0].max(), 0.55, atol=0.02)


def test_points_are_compared_on_the_objects_that_both_see():
    held, lost = partial(Verdict, reason="held", quality=0.8), partial(Verdict, reason="no region")
    usual = {"a": {1: held(1), 2: held(2)}, "b": {1: held(1)}}
    other = {"a": {1: held(1), 3: lost(3)}, "b": {1: lost(1)}}
    count, quality, region, grasp, _ = compared_cells(usual, other)
    assert count == "2"
    assert quality.startswith("0.400 (-0.400, ")
    assert region.startswith("0.500 (-0.500, ")
    assert grasp.startswith("0.500 (-0.500, ")
