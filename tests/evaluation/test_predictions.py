"""Conversion of a frame of `grasps.h5` to the predictions that are judged."""

import numpy as np
import pytest

from pipelines.errors import SymgraspError
from pipelines.evaluation.predictions import FramePredictions, RowPredictions
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from pipelines.grasping.ranked_grasps import RankedGrasps

CAMERA = Intrinsics(10.0, 10.0, 1.5, 1.0, 4, 3)


def result(rank_score: list[float], is_best: list[bool], region: list[int]) -> FrameResult:
    """Two regions, the grasps given; only the second region's sphere has parameters."""
    count = len(rank_score)
    point = np.full((2, 5, 3), np.nan)
    point[1, 4] = 0.5
    masks = [np.eye(3, 4, k, dtype=bool) for k in (0, 1)]
    regions = RegionTable.from_masks(
        masks,
        confidence=[0.9, 0.7],
        source=["detector", "geometric"],
        symmetry_confidence=np.full((2, 5), 0.6),
        symmetry_point=point,
        symmetry_direction=np.full((2, 5, 3), np.nan),
        affordance_mean=[0.5, 0.5],
        affordance_max=[0.5, 0.5],
    )
    grasps = GraspTable(
        region=np.array(region),
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        translation=np.arange(3.0 * count).reshape(count, 3),
        width=np.full(count, 0.04),
        contacts=np.zeros((count, 2, 3)),
        affordance=np.ones(count),
        symmetry_slot=np.zeros(count),
        source=np.array(["network"] * count, dtype=object),
        clearance=np.ones(count),
        enclosed_height=np.ones(count),
        rank_score=np.array(rank_score),
        is_best=np.array(is_best),
    )
    return FrameResult("f", "ok", "", CAMERA, 0.2, regions, grasps)


def test_each_region_has_its_best_grasp():
    found = FramePredictions.from_result(result([2.0, 3.0], [False, True], [1, 1])).row
    assert found.rank_score == [-np.inf, 3.0]
    assert [len(best) for best in found.best] == [0, 1]
    assert found.best[1].translation.tolist() == [[3.0, 4.0, 5.0]]


def test_masks_come_back_as_they_were():
    masks = FramePredictions.from_result(result([], [], [])).masks
    assert [np.argwhere(mask).tolist()[0] for mask in masks] == [[0, 0], [0, 1]]


def test_slots_without_parameters_do_not_exist():
    slots = FramePredictions.from_result(result([], [], [])).row.symmetries
    assert slots is not None
    assert slots[0].probability.tolist() == [0.0] * 5
    assert np.flatnonzero(slots[1].probability).tolist() == [4]


def test_a_frame_without_regions_predicts_nothing():
    found = FramePredictions.from_result(FrameResult("f", "failed", "cut off"))
    assert (found.masks, found.confidence, found.row.best) == ([], [], [])


def test_a_region_without_ranked_grasps_is_last():
    row = RowPredictions.from_ranked([RankedGrasps.empty()])
    assert row.rank_score == [-np.inf]
    assert len(row.best[0]) == 0


def test_a_frame_with_a_score_that_is_not_finite_is_refused():
    with pytest.raises(SymgraspError, match="f: the rank_score of a grasp is not finite"):
        FramePredictions.from_result(result([0.5, np.nan], [True, True], [0, 1]))
