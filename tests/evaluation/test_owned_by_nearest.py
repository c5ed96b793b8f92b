"""Grasps of methods without regions, assigned to the nearest objects of a frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.configs import EvaluateConfig
from pipelines.evaluation.frame_scores import owned_by_nearest
from pipelines.evaluation.predictions import FramePredictions, ScoredGrasps
from pipelines.evaluation.truth import TruthReader
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasping.grasps import GraspPoses
from tests.stages.toy_root import best_grasp, frame_names, grasp_table, true_result, write_root


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    root = write_root(tmp_path_factory.mktemp("root"))
    return TruthReader(root, EvaluateConfig(min_visible_pixels=100)).read(
        root.frame(frame_names()[0])
    )


def found(*objects: int, score: list[float]) -> ScoredGrasps:
    grasps = GraspPoses.concatenate([best_grasp(i, 0) for i in objects])
    return ScoredGrasps(grasps, np.array(score))


def test_each_object_gets_the_best_grasp_that_is_nearest_to_it(truth):
    row = owned_by_nearest(found(1, 0, 1, score=[0.2, 0.9, 0.7]), truth)
    assert row.owners.object_id == [0, 1, 2]
    assert row.predictions.rank_score == [0.9, 0.7, -np.inf]
    assert [len(best) for best in row.predictions.best] == [1, 1, 0]
    assert_allclose(row.predictions.best[1].translation, best_grasp(1, 0).translation)
    assert [mask.sum() for mask in row.masks] == [
        (truth.label == object_id + 1).sum() for object_id in (0, 1, 2)
    ]


def test_grasps_nearest_to_an_object_that_does_not_count_go_to_no_other_object(truth):
    hidden = [i for i in truth.visible if i != 1]
    row = owned_by_nearest(found(1, score=[0.2]), type(truth)(**vars(truth) | {"visible": hidden}))
    assert row.owners.object_id == hidden
    assert not any(map(len, row.predictions.best))


def test_without_grasps_no_object_has_one(truth):
    row = owned_by_nearest(ScoredGrasps(GraspPoses.empty(), np.zeros(0)), truth)
    assert row.predictions.rank_score == [-np.inf] * 3


def test_only_rows_of_methods_for_whole_frames_are_judged_by_nearest_object(truth, tmp_path):
    result = true_result(write_root(tmp_path), frame_names()[0])
    assert FramePredictions.from_result(result).anywhere is None
    table = grasp_table(GraspPoses.concatenate([best_grasp(i, 0) for i in (0, 1, 2)]))
    whole = FrameResult(result.name, "ok", "", result.intrinsics, 0.5, result.regions, table)
    anywhere = FramePredictions.from_result(whole, knows_regions=False).anywhere
    assert anywhere is not None
    assert len(anywhere.grasps) == 3
