"""One frame through the planner, with a stand-in for the network that knows the truth."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import (
    InferConfig,
    LimitsConfig,
    RankingConfig,
    SelectionConfig,
    SymmetryConfig,
)
from pipelines.configs.presets import preset_settings
from pipelines.configs.settings import from_settings
from pipelines.errors import SymgraspError
from pipelines.frames.rgbd import Frame
from pipelines.geometry.symmetry import ReflectionSymmetry, SymmetrySlots
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranking.ranking import are_near
from pipelines.grasping.symmetries.by_fitting import symmetries_by_fitting
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner
from pipelines.pictures.overlays import draw_overlay
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render
from tests.inference.stand_ins import Detection, Detector, Prediction

POSE = looking_at_table()
DEPTH, INDEX = render([Box((0.06, 0.09, 0.1))], POSE)
FRAME = Frame("f", np.full((240, 320, 3), 90, np.uint8), DEPTH.astype(np.float32), CAMERA)
CONFIG = InferConfig(regions="geometric")
CRITICS = {
    "symmetry_critics": models.symmetry_critics(),
    "grasp_critic": models.grasp_critic(),
}


class Oracle:
    """Predicts the box's two upright planes at every point."""

    def predict(self, clouds, table):
        middle = transform_points(POSE, [0, 0, 0.05])
        planes = [ReflectionSymmetry(POSE[:3, axis], middle) for axis in (0, 1)]
        slots = SymmetrySlots.from_symmetries(planes)
        point, direction = np.nan_to_num(slots.point), np.nan_to_num(slots.direction)
        return [
            Prediction(
                np.arange(0, len(cloud), 2),
                np.ones(len(cloud[::2])),
                *(
                    np.tile(each, (len(cloud[::6]),) + (1,) * each.ndim)
                    for each in (slots.probability, point, direction)
                ),
            )
            for cloud in clouds
        ]


def plan(predictor, symmetry_peer=None, **settings):
    planner = Planner(
        replace(CONFIG, **settings),
        load_gripper("rg2"),
        predictor=predictor,
        symmetry_peer=symmetry_peer,
        **CRITICS,
    )
    return planner.plan(FRAME, np.random.default_rng(0))


def test_predicted_symmetries_give_network_grasps_and_are_written():
    result = plan(Oracle())
    assert result.status == "ok"
    assert set(result.grasps.source[result.grasps.is_best]) == {"network"}
    # The level plane, which the network does not predict, is found by the half height.
    found = result.regions.symmetry_confidence[0] > 0.5
    assert found.tolist() == [True, True, True, False, False]
    np.testing.assert_allclose(result.regions.existence[0], [1, 1, 0, 0, 0])  # as predicted
    assert set(result.grasps.ranker) == {"critic"}
    cosine = np.abs(result.regions.symmetry_direction[0, :3] @ POSE[:3, :3])
    np.testing.assert_allclose(np.sort(cosine.max(axis=0)), 1.0, atol=1e-3)
    assert result.regions.affordance_max[0] == 1.0


def test_the_papers_preset_ranks_predicted_contacts_by_eq_8_alone():
    config = from_settings(InferConfig, preset_settings("paper", "infer"))
    detector = Detector([Detection(INDEX == 0)])
    planner = Planner(config, load_gripper("rg2"), detector, Oracle())
    result = planner.plan(FRAME, np.random.default_rng(0))
    grasps = result.grasps
    assert set(grasps.source) == {"network"}
    assert set(grasps.ranker) == {"eq8"}
    np.testing.assert_allclose(result.regions.symmetry_confidence[0], [1, 1, 0, 0, 0])
    apart = np.linalg.norm(np.diff(grasps.contacts, axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(grasps.width, apart, atol=1e-6)  # no opening margin
    b, h = (
        np.minimum(grasps.clearance, 0.05) / 0.05,
        np.minimum(grasps.enclosed_height, 0.03) / 0.03,
    )
    np.testing.assert_allclose(grasps.rank_score, np.tanh(b) * np.tanh(5.0 * h), atol=1e-6)
    mirrored = transform_points(np.linalg.inv(POSE), grasps.contacts.reshape(-1, 3)).reshape(
        -1, 2, 3
    )
    across = np.abs(mirrored.mean(axis=1)[:, :2]).min(axis=1)
    np.testing.assert_allclose(across, 0.0, atol=1e-6)  # the middle lies in a predicted plane


def thinned(kind):
    """The frame's depth with the holes that registration to a larger picture leaves."""
    depth = FRAME.depth.copy()
    match kind:
        case "rows":
            depth[1::2] = 0.0
        case "columns":
            depth[:, 1::2] = 0.0
        case "both":
            depth[1::2] = depth[:, 1::2] = 0.0
        case "random":
            depth[np.random.default_rng(0).random(depth.shape) < 0.6] = 0.0
    return replace(FRAME, depth=depth)


@pytest.mark.parametrize("kind", ["rows", "columns", "both", "random"])
def test_a_frame_with_a_hole_next_to_every_pixel_is_grasped(kind):
    planner = Planner(CONFIG, load_gripper("rg2"), predictor=Oracle(), **CRITICS)
    result = planner.plan(thinned(kind), np.random.default_rng(0))
    assert result.status == "ok", result.message
    width, height = result.size
    mask, expected = result.regions.mask(0, width, height), INDEX == 0
    assert (mask & expected).sum() > 0.85 * (mask | expected).sum()
    whole = np.asarray(plan(Oracle()).grasps.width[0])
    np.testing.assert_allclose(np.asarray(result.grasps.width[0]), whole, atol=0.012)


def test_without_a_network_grasps_are_planar_and_have_no_affordance():
    result = plan(None)
    assert set(result.grasps.source) == {"planar"}
    assert np.isnan(result.regions.affordance_mean[0])
    assert np.isnan(result.regions.existence).all()
    assert set(result.grasps.ranker) == {"eq8"}


def test_each_grasp_names_the_source_of_its_symmetry():
    assert set(plan(None).grasps.symmetry_source) == {""}
    for candidates in ("network", "shape"):
        chosen = SelectionConfig(symmetry=SymmetryConfig(candidates=candidates))
        grasps = plan(Oracle(), selection=chosen).grasps
        rests = grasps.symmetry_slot >= 0
        assert rests.any()
        assert set(grasps.symmetry_source[rests]) == {candidates}
        assert set(grasps.symmetry_source[~rests]) <= {""}


def test_no_more_grasps_per_region_than_configured_are_kept():
    result = plan(Oracle())
    assert len(result.grasps) <= CONFIG.max_grasps_per_region
    assert result.grasps.is_best.sum() == 1


def test_low_scores_are_marked_or_left_out_and_the_best_of_them_is_reported():
    marked = plan(Oracle(), weak_below=1.0).grasps
    assert marked.worth_trying.tolist() == (marked.rank_score >= 1.0).tolist()
    some = float(marked.rank_score.max()) - 1e-3
    kept = plan(Oracle(), min_score=some).grasps.rank_score
    assert kept.tolist() == [score for score in marked.rank_score if score >= some]
    none = plan(Oracle(), min_score=1.0)
    assert none.status == "empty"
    assert "scores min_score or more; the best has" in none.message


def test_the_overlay_marks_planes_regions_and_gripper():
    with_network, without = draw_overlay(FRAME, plan(Oracle())), draw_overlay(FRAME, plan(None))
    assert (with_network != FRAME.color).any()
    assert (with_network != without).mean() > 0.01  # the planes' sheets


def test_the_overlay_of_an_empty_frame_equals_the_colour_image():
    bare = Frame("bare", FRAME.color, np.zeros_like(FRAME.depth), CAMERA)
    result = Planner(CONFIG, load_gripper("rg2")).plan(bare, np.random.default_rng(0))
    assert result.status == "empty"
    np.testing.assert_array_equal(draw_overlay(bare, result), FRAME.color)


def test_missing_critics_of_symmetries_raise_an_error():
    with pytest.raises(SymgraspError, match="need critics"):
        Planner(CONFIG, load_gripper("rg2"), predictor=Oracle())


def test_a_missing_grasp_critic_raises_an_error():
    critics = CRITICS["symmetry_critics"]
    with pytest.raises(SymgraspError, match="need a grasp critic"):
        Planner(CONFIG, load_gripper("rg2"), predictor=Oracle(), symmetry_critics=critics)
    as_paper = replace(CONFIG, selection=SelectionConfig(ranking=RankingConfig(by="eq8")))
    Planner(as_paper, load_gripper("rg2"), predictor=Oracle(), symmetry_critics=critics)


def limited(workspace=None, **settings):
    config = replace(CONFIG, limits=LimitsConfig(**settings))
    planner = Planner(config, load_gripper("rg2"), predictor=Oracle(), **CRITICS)
    return planner.plan(FRAME, np.random.default_rng(0), workspace=workspace)


def test_regions_outside_the_workspace_are_left_out():
    away = (0.3, -1.0, 0.0, 1.0, 1.0, 2.0)
    result = limited(box=away)
    assert result.status == "empty"
    assert "workspace" in result.message
    assert len(result.regions.confidence) == 0
    everywhere = limited(np.ones(DEPTH.shape, bool), box=(-9.0, -9.0, -9.0, 9.0, 9.0, 9.0))
    np.testing.assert_array_equal(everywhere.grasps.rotation, plan(Oracle()).grasps.rotation)


def test_grasps_stay_within_the_workspace_and_the_cone():
    mask = np.zeros(DEPTH.shape, bool)
    _, columns = np.nonzero(INDEX == 0)
    mask[:, : int(np.median(columns))] = True
    grasps = limited(mask, approach_cone=45.0).grasps
    assert len(grasps) > 0
    u, v = np.round(CAMERA.project(np.asarray(grasps.translation, np.float64))).astype(int).T
    assert mask[v, u].all()
    steepness = -np.asarray(grasps.rotation)[:, :, 0] @ POSE[:3, 2]
    assert (steepness > np.cos(np.radians(45.1))).all()


def test_no_two_grasps_of_a_region_are_similar():
    found = plan(Oracle()).grasps
    grasps = GraspPoses(
        *(np.asarray(a, np.float64) for a in (found.rotation, found.translation, found.width))
    )
    ranking = CONFIG.selection.ranking
    near = are_near(grasps, ranking.nms_distance, ranking.nms_angle - 1e-3)
    assert near.sum() == len(grasps) > 1


def of_masks(masks, frame=FRAME, **limits):
    config = replace(CONFIG, method="planar", limits=LimitsConfig(**limits))
    result = Planner(config, load_gripper("rg2")).plan(
        frame, np.random.default_rng(0), masks.astype(np.int32)
    )
    assert result.status == "empty"
    return result.message


def speck(rows=5, columns=6):
    """Instance 1: a few pixels of the box."""
    masks = np.zeros(DEPTH.shape, int)
    row, column = (int(np.median(each)) for each in np.nonzero(INDEX == 0))
    masks[row : row + rows, column : column + columns] = 1
    return masks


BARE = replace(FRAME, depth=np.where(INDEX == 0, 0, DEPTH).astype(np.float32))


@pytest.mark.parametrize("limits", [{}, {"box": (-9.0, -9.0, -9.0, 9.0, 9.0, 9.0)}])
def test_instances_that_are_too_small_are_reported_to_be(limits):
    # In a small image an instance needs fewer than 200 pixels.
    message = of_masks(speck(), **limits)
    assert message == (
        "dropped 1 of 1 instance of the masks as too small; an instance needs 50 pixels"
    )


@pytest.mark.parametrize("limits", [{}, {"box": (-9.0, -9.0, -9.0, 9.0, 9.0, 9.0)}])
def test_instances_without_depth_are_reported_to_have_none(limits):
    message = of_masks(INDEX == 0, BARE, **limits)
    assert message == ("too little depth was measured in 1 region; a region needs 20 points")


def test_every_reason_for_instances_without_grasps_is_reported():
    masks = np.where(INDEX == 0, 2, 0)
    masks[:5, :6] = 1
    message = of_masks(masks, BARE)
    assert "measured in 1 region" in message
    assert "dropped 1 of 2 instances of the masks as too small" in message


def test_instances_keep_their_ids_where_others_are_too_small_which_is_noted():
    masks = np.where(INDEX == 0, 7, 0).astype(np.int32)
    masks[:5, :6] = 1
    planner = Planner(replace(CONFIG, method="planar"), load_gripper("rg2"))
    result = planner.plan(FRAME, np.random.default_rng(0), masks)
    assert result.status == "ok"
    assert result.regions.instance.tolist() == [7]
    assert result.message.startswith("dropped 1 of 2 instances of the masks as too small; ")
    masks[:5, :6] = 0
    assert not planner.plan(FRAME, np.random.default_rng(0), masks).message


def test_masks_without_instances_are_reported_to_show_none():
    assert "masks contain no instance" in of_masks(np.zeros(DEPTH.shape))


def test_regions_that_no_gripper_reaches_are_reported_to_be_out_of_reach():
    lone = replace(FRAME, depth=np.where(INDEX == 0, 1.9, 0).astype(np.float32))
    assert "none of 1 region has a grasp" in of_masks(INDEX == 0, lone)


def test_masked_objects_are_grasped_without_any_depth_around_them():
    masks = (INDEX + 1).astype(np.int32)
    alone = replace(FRAME, depth=np.where(masks > 0, FRAME.depth, 0.0).astype(np.float32))
    for method in ("planar", "random"):
        planner = Planner(replace(CONFIG, method=method), load_gripper("rg2"), **CRITICS)
        result = planner.plan(alone, np.random.default_rng(0), masks)
        assert result.status == "ok", f"{method}: {result.message}"


def test_symmetries_are_fitted_without_a_network_and_grasps_across_them_ranked_by_the_critic():
    result = plan(
        None, lambda cloud, scene, _: symmetries_by_fitting(cloud, scene), method="symmetry-icp"
    )
    slot = int(result.regions.symmetry_confidence[0, :3].argmax())
    assert result.regions.symmetry_confidence[0, slot] > 0.9
    assert abs(result.regions.symmetry_direction[0, slot] @ POSE[:3, 0]) > 0.999
    assert set(result.grasps.ranker) == {"critic"}
