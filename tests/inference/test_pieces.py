"""Detections of several objects are split; detections of one object stay whole."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import InferConfig, RankingConfig, SelectionConfig, SymmetryConfig
from pipelines.frames.rgbd import Frame
from pipelines.geometry.symmetry import ReflectionSymmetry, SymmetrySlots
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.plans import Plan, with_pieces
from pipelines.inference.regions.regions import Region, pieces_of
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render
from tests.inference.stand_ins import Detection, Detector, Prediction

POSE = looking_at_table()
# As one region these two would be held only at the smaller box, which is tall.
LARGE, SMALL = Box((0.1, 0.1, 0.06)), Box((0.05, 0.06, 0.12), at=(0.1, 0.0, 0.0))


class NoSymmetry:
    """Predicts no symmetry at every point."""

    def predict(self, clouds, table):
        return [
            Prediction(
                np.arange(len(cloud)),
                np.ones(len(cloud)),
                np.zeros((len(cloud[::3]), 5)),
                np.zeros((len(cloud[::3]), 5, 3)),
                np.zeros((len(cloud[::3]), 5, 3)),
            )
            for cloud in clouds
        ]


class TwoPlanes(NoSymmetry):
    """Predicts the upright planes of the box in the middle."""

    def predict(self, clouds, table):
        planes = [
            ReflectionSymmetry(POSE[:3, axis], transform_points(POSE, [0, 0, 0.03]))
            for axis in (0, 1)
        ]
        slots = SymmetrySlots.from_symmetries(planes)
        votes = slots.probability, np.nan_to_num(slots.point), np.nan_to_num(slots.direction)
        return [
            Prediction(
                each.index,
                each.affordance,
                *(np.tile(part, (len(each.existence),) + (1,) * part.ndim) for part in votes),
            )
            for each in super().predict(clouds, table)
        ]


def planned(boxes, predictor, regions="auto", detection=lambda index: index >= 0, **planning):
    """Return the result of a frame with one detection, and the index of each pixel's box."""
    depth, index = render(boxes, POSE)
    frame = Frame("f", np.full((240, 320, 3), 90, np.uint8), depth.astype(np.float32), CAMERA)
    # Symmetries of the stand-in are not fitted. Two boxes have no common weight.
    ranking = RankingConfig(half_torque_arm=1e3)
    selection = SelectionConfig(symmetry=SymmetryConfig(is_fitted=False), ranking=ranking)
    config = InferConfig(regions=regions, selection=selection)
    critic = models.grasp_critic()
    planner = Planner(
        config,
        load_gripper("rg2"),
        Detector([Detection(detection(index))]),
        predictor,
        grasp_critic=critic,
    )
    return planner.plan(frame, np.random.default_rng(0), **planning), index


def held(result, index):
    """Map each region to the boxes whose pixels contain the midpoints of its grasps."""
    middle = np.asarray(result.grasps.translation, np.float64)
    u, v = np.round(CAMERA.project(middle)).astype(int).T
    regions, boxes = np.asarray(result.grasps.region), index[v, u]
    return {int(region): set(boxes[regions == region].tolist()) for region in np.unique(regions)}


def test_two_objects_in_a_detection_get_separate_grasps():
    result, index = planned([LARGE, SMALL], NoSymmetry())
    assert result.regions.source.tolist() == ["detector", "geometric"]
    assert held(result, index) == {0: {0}, 1: {1}}  # the detection has the larger box
    height, width = index.shape
    piece = result.regions.mask(1, width, height)
    assert (index[piece] == 1).mean() > 0.95
    assert piece.sum() > 0.9 * (index == 1).sum()


def with_strip(share):
    """Return a detection of the first box with a strip of the second, `share` of its pixels."""

    def detection(index):
        strip = np.cumsum((index == 1).ravel()).reshape(index.shape)
        return (index == 0) | (index == 1) & (strip <= share * np.count_nonzero(index == 0))

    return detection


def test_a_strip_of_another_object_is_cut_off():
    result, index = planned([LARGE, SMALL], NoSymmetry(), detection=with_strip(0.06))
    height, width = index.shape
    own = result.regions.mask(0, width, height)
    assert not (own & (index == 1)).any()
    assert own.sum() > 0.95 * (index == 0).sum()
    assert held(result, index)[0] == {0}


def test_a_strip_no_wider_than_the_error_of_a_mask_is_kept():
    result, index = planned([LARGE, SMALL], NoSymmetry(), detection=with_strip(0.01))
    height, width = index.shape
    assert (result.regions.mask(0, width, height) & (index == 1)).any()


def test_one_object_stays_one_region():
    result, index = planned([LARGE], NoSymmetry())
    assert held(result, index) == {0: {0}}


def test_a_region_with_a_symmetric_grasp_is_not_split():
    result, _ = planned([LARGE, SMALL], TwoPlanes())
    assert result.grasps.symmetry_slot[0] >= 0
    assert result.regions.source.tolist() == ["detector"]


def test_the_detector_alone_is_not_corrected_by_depth():
    result, _ = planned([LARGE, SMALL], NoSymmetry(), regions="detector")
    assert result.regions.source.tolist() == ["detector"]


def test_regions_of_the_users_masks_are_not_split():
    index = render([LARGE, SMALL], POSE)[1]
    result, _ = planned([LARGE, SMALL], NoSymmetry(), masks=(index >= 0).astype(np.int32))
    assert result.regions.source.tolist() == ["masks"]


@pytest.mark.parametrize(("share", "count"), [(0.1, 3), (0.15, 2), (0.4, 0)])
def test_pieces_are_large_enough_and_sorted_largest_first(share, count):
    labels = np.zeros((40, 50), np.int32)
    labels[:, :20], labels[:, 20:45], labels[:, 45:] = 3, 1, 2  # 800, 1000 and 200 pixels
    mask = np.ones(labels.shape, bool)
    mask[:, 0] = False
    config = InferConfig(min_piece_share=share, min_region_pixels=150)
    pieces = pieces_of(mask, labels, config)
    assert len(pieces) == count
    sizes = [int(piece.sum()) for piece in pieces]
    assert sizes == [1000, 760, 200][:count]
    assert all((piece <= mask).all() for piece in pieces)


def test_a_mask_that_no_geometric_region_covers_is_one_piece():
    assert pieces_of(np.ones((30, 30), bool), np.zeros((30, 30), np.int32), InferConfig()) == []


def plan_with(count: int) -> Plan:
    nothing = RankedGrasps.empty()
    poses = GraspPoses(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), np.ones(count))
    slots, sources = np.full(count, -1), np.full(count, "planar")
    return Plan(
        replace(nothing, grasps=poses, slot=slots, source=sources, rank_score=np.zeros(count))
    )


def test_plans_of_pieces_become_plans_of_their_region_and_of_further_regions():
    whole = [Region(np.ones((2, 3), bool), 0.9, "detector") for _ in range(4)]
    plans = [plan_with(0) for _ in whole]
    left, right = (np.arange(3) < 2)[None].repeat(2, 0), (np.arange(3) == 2)[None].repeat(2, 0)
    pieces = {0: [], 1: [left], 2: [left, right], 3: [left, right]}
    of_pieces = {
        0: [],
        1: [plan_with(0)],
        2: [plan_with(1), plan_with(2)],
        3: [plan_with(0), plan_with(3)],
    }
    regions, planned = with_pieces(whole, plans, pieces, of_pieces, 0.4)
    assert [len(plan.grasps) for plan in planned] == [0, 0, 1, 0, 2, 3]
    assert planned[1] is of_pieces[1][0]
    assert [region.mask.sum() for region in regions] == [6, 4, 6, 6, 2, 2]
    assert [region.source for region in regions] == ["detector"] * 4 + ["geometric"] * 2
    assert regions[-1].confidence == 0.4
