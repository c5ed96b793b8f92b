"""Compared methods that find grasps in whole frames, through the planner."""

import numpy as np
import pytest

from pipelines.configs import InferConfig
from pipelines.frames.rgbd import Frame
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.peers.frame_plans import MOST_GRASPS
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render

POSE = looking_at_table()
DEPTH, INDEX = render([Box((0.06, 0.09, 0.1))], POSE)
FRAME = Frame("f", np.full((240, 320, 3), 90, np.uint8), DEPTH.astype(np.float32), CAMERA)
ON_BOX, OFF_BOX = (transform_points(POSE, place) for place in ([0, 0, 0.08], [0.3, 0.1, 0.02]))


class Fixed:
    """Finds the same grasps in every frame."""

    def __init__(self, places, scores):
        count = len(scores)
        self.found = GraspPoses(np.tile(np.eye(3), (count, 1, 1)), places, np.full(count, 0.05))
        self.score = np.array(scores, float)

    def __call__(self, frame, scene, rng):
        self.scene = scene
        return self.found, self.score


def plan(method, **settings):
    config = InferConfig(method="gg-cnn", regions="geometric", **settings)
    return Planner(config, load_gripper("rg2"), peer=method).plan(FRAME, np.random.default_rng(0))


def test_grasps_belong_to_the_region_they_are_near_and_others_to_the_rest():
    result = plan(Fixed([ON_BOX, OFF_BOX], [0.5, 0.9]))
    assert result.regions.source.tolist() == ["geometric", "rest"]
    assert result.grasps.region.tolist() == [0, 1]
    assert result.grasps.source.tolist() == ["gg-cnn"] * 2
    assert result.grasps.ranker.tolist() == ["own"] * 2
    assert result.grasps.rank_in_frame.tolist() == [1, 0]
    assert not (result.regions.mask(0, 320, 240) & result.regions.mask(1, 320, 240)).any()


def test_a_method_is_given_the_pixels_of_the_regions():
    method = Fixed([ON_BOX], [0.5])
    result = plan(method)
    np.testing.assert_array_equal(method.scene.objects, result.regions.mask(0, 320, 240))


def test_there_is_no_rest_if_all_grasps_are_near_regions():
    assert plan(Fixed([ON_BOX], [0.5])).regions.source.tolist() == ["geometric"]


def test_a_frame_without_a_grasp_is_empty():
    result = plan(Fixed(np.zeros((0, 3)), []))
    assert (result.status, result.message) == (
        "empty",
        "gg-cnn finds no allowed grasp with a sufficient score",
    )


def test_the_best_of_similar_grasps_stays():
    result = plan(Fixed([ON_BOX, ON_BOX + 0.01], [0.5, 0.9]))
    assert result.grasps.rank_score.tolist() == pytest.approx([0.9])


def test_no_more_than_300_grasps_are_kept():
    places = np.stack(np.meshgrid(*[np.arange(8) * 0.1] * 3), -1).reshape(-1, 3)
    found = plan(Fixed(places, np.arange(len(places)))).grasps.rank_score
    assert len(found) == MOST_GRASPS
    assert found.max() == len(places) - 1


def test_our_selection_drops_grasps_that_collide_and_those_on_no_region():
    """A grasp across the box from above is kept; one 6 cm deeper and one on the table are not."""
    down = GraspPoses.from_contacts(
        transform_points(POSE, [[[-0.03, 0, z], [0.03, 0, z]] for z in (0.08, 0.02)]),
        np.tile(-POSE[:3, 2], (2, 1)),
    )
    method = Fixed([ON_BOX, ON_BOX, OFF_BOX], [0.5, 0.9, 0.7])
    method.found = GraspPoses.concatenate([down, method.found[2:]])
    assert len(plan(method).grasps) == 3
    result = plan(method, selects_for_compared_methods=True)
    assert result.regions.source.tolist() == ["geometric"]
    assert result.grasps.rank_score.tolist() == pytest.approx([0.5])
