"""Scores of one frame: predictions compared with the ground truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Mask
from pipelines.configs import EvaluateConfig
from pipelines.evaluation.predictions import FramePredictions, RowPredictions, ScoredGrasps
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions, number_key
from pipelines.evaluation.truth import FrameTruth
from pipelines.geometry.symmetry import SYMMETRY_KINDS, SymmetrySlots
from pipelines.geometry.transforms import nearest_orthogonal
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.metrics.coco_masks import IOU_THRESHOLDS, match_masks
from pipelines.metrics.grasp_verdicts import Verdict, grasp_verdict
from pipelines.metrics.graspnet.graspnet_ap import AP_FRICTIONS
from pipelines.metrics.mask_overlap import mask_iou, owner_of
from pipelines.metrics.symmetry_matching import (
    CORRECT,
    WRONG,
    PredictedSymmetry,
    scored_symmetries,
    symmetry_verdicts,
)


@dataclass(frozen=True)
class RegionOwners:
    """The true owners of the predicted regions; one entry per region, -1 without an owner."""

    object_id: list[int]  # the object that most of the region covers
    instance: list[int]  # index of the true symmetric region with the largest overlap


@dataclass(frozen=True)
class RegionRow:
    """Predictions of one method on the regions of a frame; each of `masks` is (H, W)."""

    predictions: RowPredictions
    masks: list[Mask]
    owners: RegionOwners


def assign_regions(
    masks: Sequence[Mask], truth: FrameTruth, config: EvaluateConfig
) -> RegionOwners:
    """Return the object and the true region of each of the predicted `masks`, each (H, W)."""
    objects = [owner_of(mask, truth.label, config.min_region_share) - 1 for mask in masks]
    iou = mask_iou(masks, [instance.mask for instance in truth.instances])
    if iou.size == 0:
        return RegionOwners(objects, [-1] * len(masks))
    nearest = np.where(iou.max(axis=1) >= config.min_region_iou, iou.argmax(axis=1), -1)
    return RegionOwners(objects, nearest.tolist())


def owned_by_nearest(found: ScoredGrasps, truth: FrameTruth) -> RegionRow:
    """Return the best grasp on each visible object, or none, of a method that knows no regions.

    A grasp belongs to the object with the true surface nearest to the midpoint of the contacts.
    The truth only assigns: a method that finds grasps in the whole frame names no object.
    """
    owner = truth.scene.nearest_object(found.grasps.translation)
    best, score = [], []
    for object_id in truth.visible:
        own = np.flatnonzero(owner == object_id)
        first = own[found.score[own].argmax()] if len(own) else len(found.score)
        best.append(found.grasps[first : first + 1])
        score.append(float(found.score[first]) if len(own) else -np.inf)
    masks = [truth.label == object_id + 1 for object_id in truth.visible]
    owners = RegionOwners(list(truth.visible), [-1] * len(truth.visible))
    return RegionRow(RowPredictions(best, score, every=found), masks, owners)


def best_region(object_id: int, row: RowPredictions, owners: RegionOwners) -> int | None:
    """Return the region of an object that has the best grasp; None for an object without one."""
    regions = [i for i, owner in enumerate(owners.object_id) if owner == object_id]
    return max(regions, key=lambda i: row.rank_score[i], default=None)


def score_frame(
    predictions: Mapping[str, FramePredictions],
    rows: dict[str, RegionRow],
    truth: FrameTruth,
    gripper: Gripper,
    config: EvaluateConfig,
) -> FrameRecord:
    """Return the record of one frame: scores of all `rows`, and of the masks of `predictions`.

    `predictions`: by row, including ours; each file has its own regions.
    """
    ours = predictions[OURS]
    own = {
        name: _scored_masks(each, truth)
        for name, each in predictions.items()
        if name != OURS and each.anywhere is None
    }
    scored = {
        name: _scored_row(row, own.get(name), truth, gripper, config) for name, row in rows.items()
    }
    return FrameRecord(ours.name, truth.split, ours.seconds, _scored_masks(ours, truth), scored)


def _scored_masks(predictions: FramePredictions, truth: FrameTruth) -> ScoredPredictions:
    true_masks = [instance.mask for instance in truth.instances]
    right = match_masks(predictions.masks, predictions.confidence, true_masks)
    found = {
        number_key(iou): np.where(verdicts, CORRECT, WRONG).tolist()
        for iou, verdicts in zip(IOU_THRESHOLDS, right, strict=True)
    }
    return ScoredPredictions(len(true_masks), list(predictions.confidence), found)


def _scored_row(
    row: RegionRow,
    masks: ScoredPredictions | None,
    truth: FrameTruth,
    gripper: Gripper,
    config: EvaluateConfig,
) -> RowRecord:
    found, owners = row.predictions, row.owners
    verdicts = [
        _object_verdict(object_id, found, owners, truth, gripper) for object_id in truth.visible
    ]
    slots: dict[str, ScoredPredictions] = {}
    if found.symmetries is not None:
        slots = _scored_slots(found.symmetries, owners, truth, config)
    return RowRecord(verdicts, slots, _accuracy(found.every, truth, gripper), masks)


def _accuracy(found: ScoredGrasps | None, truth: FrameTruth, gripper: Gripper) -> list[float]:
    """Return the mean accuracy over ranks at each of `AP_FRICTIONS`, by GraspNet's protocol."""
    if found is None:
        return [0.0] * len(AP_FRICTIONS)
    exact = nearest_orthogonal(found.grasps.rotation)  # stored in single precision
    grasps = GraspPoses(exact, found.grasps.translation, found.grasps.width)
    mean: list[float] = truth.scene.accuracy(grasps, found.score, gripper).mean(axis=0).tolist()
    return mean


def _object_verdict(
    object_id: int, row: RowPredictions, owners: RegionOwners, truth: FrameTruth, gripper: Gripper
) -> Verdict:
    """Return the verdict on the best grasp of all regions of one object."""
    chosen = best_region(object_id, row, owners)
    if chosen is None:
        return Verdict(object_id, "no region")
    if not len(row.best[chosen]):
        return Verdict(object_id, "no grasp")
    return grasp_verdict(truth.scene, object_id, row.best[chosen], gripper)


def _scored_slots(
    slots: Sequence[SymmetrySlots], owners: RegionOwners, truth: FrameTruth, config: EvaluateConfig
) -> dict[str, ScoredPredictions]:
    """Return the verdicts on every slot of every region; AP ranks slots of any confidence."""
    predicted = [
        PredictedSymmetry(symmetry, float(region.probability[slot]), owner)
        for region, owner in zip(slots, owners.instance, strict=True)
        for slot, symmetry in region.between(0.0)
    ]
    return {
        kind: _scored_kind([p for p in predicted if p.symmetry.kind == kind], kind, truth, config)
        for kind in SYMMETRY_KINDS
    }


def _scored_kind(
    predicted: Sequence[PredictedSymmetry], kind: str, truth: FrameTruth, config: EvaluateConfig
) -> ScoredPredictions:
    thresholds = (config.sphere_threshold,) if kind == "sphere" else config.symmetry_thresholds
    return ScoredPredictions(
        sum(len(scored_symmetries(region, kind)) for region in truth.regions),
        [prediction.confidence for prediction in predicted],
        {
            number_key(t): symmetry_verdicts(predicted, truth.regions, t).tolist()
            for t in thresholds
        },
    )
