"""Regions that the detector did not find, rated by its confidence in their boxes."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import InferConfig
from pipelines.frames.rgbd import Frame
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.observation import observe
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render
from tests.inference.stand_ins import Detection, Detector, Prediction

NEAR, FAR = Box((0.06, 0.09, 0.1), (-0.12, 0, 0)), Box((0.06, 0.09, 0.1), (0.12, 0, 0))
DEPTH, INDEX = render([NEAR, FAR], looking_at_table())
FRAME = Frame("f", np.full((240, 320, 3), 90, np.uint8), DEPTH.astype(np.float32), CAMERA)
FIRST, SECOND = INDEX == 0, INDEX == 1
PLANAR = replace(InferConfig(), method="planar", regions="auto")


def detector(rating: float) -> Detector:
    """Return a detector of the first box that gives other boxes one rating."""
    return Detector([Detection(FIRST)], rate=lambda box: rating)


def planned(rating: float, config=PLANAR, **options):
    planner = Planner(config, load_gripper("rg2"), detector(rating))
    return planner.plan(FRAME, np.random.default_rng(0), **options)


def test_the_detector_is_asked_for_the_box_of_a_region_that_it_did_not_find():
    boxes = []
    asked = Detector([Detection(FIRST)], rate=lambda box: boxes.append(box) or 0.5)
    seen = observe(FRAME, PLANAR, np.random.default_rng(0), detector=asked)
    assert [region.source for region in seen.regions] == ["detector", "geometric"]
    rows, columns = np.nonzero(seen.regions[1].mask)
    box = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
    np.testing.assert_array_equal(boxes, [box])


def test_a_region_with_a_rating_below_the_limit_is_left_out():
    assert len(planned(1.01e-4).regions) == 2
    assert planned(0.99e-4).regions.source.tolist() == ["detector"]
    assert len(planned(0.99e-4, replace(PLANAR, min_rating=0.0)).regions) == 2


def test_confidence_and_scores_grow_with_the_rating():
    results = [planned(rating) for rating in (0.001, 0.02, 0.9)]
    confidence = np.array([result.regions.confidence for result in results])
    assert (confidence[:, 0] == 0.9).all()  # of the detection
    assert confidence[0, 1] < 0.3
    assert 0.45 < confidence[1, 1] < 0.75
    assert confidence[2, 1] > 0.95
    best = np.array([r.grasps.rank_score[r.grasps.is_best] for r in results])
    np.testing.assert_allclose(best[:, 0], best[0, 0])
    np.testing.assert_allclose(best[:, 1] / confidence[:, 1], best[0, 1] / confidence[0, 1], 1e-5)


class NoSymmetry:
    """Predicts no symmetry, so that all candidates come from the shape."""

    def predict(self, clouds, table):
        return [
            Prediction(
                np.arange(0, len(cloud), 2),
                np.ones(len(cloud[::2])),
                np.zeros((len(cloud[::6]), 5)),
                *np.zeros((2, len(cloud[::6]), 5, 3)),
            )
            for cloud in clouds
        ]


def test_confidence_of_symmetries_grows_with_the_rating():
    critics = {"symmetry_critics": models.symmetry_critics(), "grasp_critic": models.grasp_critic()}
    low, high = (
        Planner(InferConfig(), load_gripper("rg2"), detector(rating), NoSymmetry(), **critics)
        .plan(FRAME, np.random.default_rng(0))
        .regions
        for rating in (0.02, 0.9)
    )
    assert high.symmetry_confidence.max(axis=1).min() > 0.5
    np.testing.assert_array_equal(low.symmetry_confidence[0], high.symmetry_confidence[0])
    np.testing.assert_allclose(
        low.symmetry_confidence[1] / low.confidence[1],
        high.symmetry_confidence[1] / high.confidence[1],
        rtol=1e-5,
    )
    assert low.confidence[1] < 0.8 * high.confidence[1]


@pytest.mark.parametrize("rating", [0.0, 1.0])
def test_a_certain_rating_gives_a_number(rating):
    result = planned(rating, replace(PLANAR, min_rating=0.0))
    assert np.isfinite(result.regions.confidence).all()
    assert np.isfinite(result.grasps.rank_score).all()


def test_a_frame_of_improbable_regions_alone_says_so():
    planner = Planner(PLANAR, load_gripper("rg2"), Detector([], rate=lambda box: 0.0))
    result = planner.plan(FRAME, np.random.default_rng(0))
    assert (result.status, len(result.regions)) == ("empty", 0)
    assert "rates 2 regions as no object; see min_rating" in result.message


def test_masks_of_the_user_are_not_rated():
    result = planned(0.0, masks=np.where(SECOND, 1, 0).astype(np.int32))
    assert result.regions.source.tolist() == ["masks"]
    assert result.regions.confidence.tolist() == [1.0]
