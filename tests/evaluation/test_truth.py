"""The ground truth of a frame, as input of the metrics."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.configs import EvaluateConfig
from pipelines.evaluation.truth import TruthReader, region_points
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.region_masks import RegionInstance
from pipelines.geometry.transforms import make_pose, random_rotation
from tests.metrics.shapes import ball, surface
from tests.stages.toy_root import frame_names, write_root

CAMERA = Intrinsics(200.0, 200.0, 79.5, 59.5, 160, 120)
MIDDLE = np.array([0.0, 0.0, 0.5])


def points_of_ball(mask):
    points, normals = surface(ball(0.05), 2000)
    pose = make_pose(random_rotation(np.random.default_rng(0)), MIDDLE)
    target = SimpleNamespace(points=points, normals=normals)
    scene = SimpleNamespace(objects={3: target}, poses={3: pose})
    return region_points(RegionInstance(3, "whole", mask, 1.0, ()), scene, CAMERA)


def test_the_points_of_a_region_face_the_camera_and_lie_in_its_mask():
    left = np.zeros((120, 160), bool)
    left[:, :80] = True
    found = points_of_ball(left)
    assert len(found) > 300
    np.testing.assert_allclose(np.linalg.norm(found - MIDDLE, axis=1), 0.05, rtol=0.02)
    assert found[:, 0].max() < 0.002  # left of the camera's axis, to within a pixel
    # A ball of 5 cm at 50 cm shows a cap: points nearer by at least 0.05^2 / 0.5 = 5 mm.
    assert found[:, 2].max() < 0.5 - 0.005 + 0.003


def test_too_small_a_region_is_represented_by_the_whole_object():
    found = points_of_ball(np.zeros((120, 160), bool))
    assert (found[:, 2] > 0.5).mean() > 0.4


@pytest.mark.parametrize(("least", "visible"), [(100, [0, 1, 2]), (1500, [0, 1]), (2300, [0])])
def test_an_object_counts_if_enough_of_its_pixels_are_seen(least, visible, tmp_path):
    root = write_root(tmp_path)  # about 2600, 2100 and 950 pixels
    reader = TruthReader(root, EvaluateConfig(min_visible_pixels=least))
    assert reader.read(root.frame(frame_names()[0])).visible == visible
