"""Validation figures of a grasp network on labelled regions."""

from collections import defaultdict

import numpy as np
import torch
from torch import Tensor

from pipelines.configs import EvaluateConfig
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.geometry.symmetry_votes import mean_slots
from pipelines.network.model import Prediction
from pipelines.network.predictor import VOTING_STRIDE
from pipelines.network.training.dense_error import reflection_errors, reflection_extent
from pipelines.network.training.matching import NUM_REFLECTIONS, match_reflections
from pipelines.network.training.region_batch import RegionBatch

GRASPABLE = 0.5  # least affordance of a grasped point (Sec. III-E)
HIT = EvaluateConfig.symmetry_thresholds[0]  # dense error below which a plane is found, D. 11
NUM_FIGURE_POINTS = 64  # points of a region that dense errors are measured on; chosen by eye
MEDIANS = ("plane_angle_deg", "plane_dense_error", "axis_angle_deg", "sphere_offset_m")


class RegionFigures:
    """Errors of predictions on labelled regions, collected batch by batch."""

    def __init__(self) -> None:
        self._parts: defaultdict[str, list[Tensor]] = defaultdict(list)

    @torch.no_grad()
    def add(self, prediction: Prediction, truth: RegionBatch) -> None:
        """Add the predictions for all points of one batch, averaged as `infer` averages them."""
        points = truth.points[:, :: max(1, truth.points.shape[1] // NUM_FIGURE_POINTS)]
        parts, (existence, means, lines) = self._parts, mean_symmetries(prediction)
        normals, places = lines[:, None, :NUM_REFLECTIONS], means[:, None, :NUM_REFLECTIONS]
        truth = match_reflections(truth, points, normals, places, means.new_ones(len(means), 1))
        parts["affordance"].append(prediction.affordance.flatten())
        parts["true_affordance"].append(truth.affordance.flatten())
        parts["right"].append((existence > 0.5) == (truth.existence > 0.5))
        for slot in range(NUM_REFLECTIONS):
            rows = truth.existence[:, slot] > 0
            normal, center = truth.direction[rows, slot], truth.center[rows, slot]
            parts["plane_angle_deg"].append(_angle_deg(lines[rows, slot], normal))
            error = reflection_errors(
                points[rows], lines[rows, slot, None], means[rows, slot, None], normal, center
            )
            parts["plane_dense_error"].append(
                error[:, 0] / reflection_extent(points[rows], normal, center)
            )
        rows = truth.existence[:, ROTATION_SLOT] > 0
        axis = truth.direction[rows, ROTATION_SLOT]
        parts["axis_angle_deg"].append(_angle_deg(lines[rows, ROTATION_SLOT], axis))
        rows = truth.existence[:, SPHERE_SLOT] > 0
        offset = means[rows, SPHERE_SLOT] - truth.center[rows, SPHERE_SLOT]
        parts["sphere_offset_m"].append(offset.norm(dim=-1))

    def figures(self) -> dict[str, float]:
        """Return the figures by name: degrees, metres, shares; without kinds that have no truth."""
        found = {name: torch.cat(parts) for name, parts in self._parts.items()}
        affordance, truth = found["affordance"], found["true_affordance"]
        right, errors = found["right"].float().mean(0), found["plane_dense_error"]
        figures = {
            "affordance_mae": float((affordance.clamp(0, 1) - truth).abs().mean()),
            "affordance_auc": area_under_roc(affordance, truth > GRASPABLE),
            "existence_accuracy": float(right.mean()),
            "reflection_accuracy": float(right[:NUM_REFLECTIONS].mean()),
            "rotation_accuracy": float(right[ROTATION_SLOT]),
            "sphere_accuracy": float(right[SPHERE_SLOT]),
        }
        figures |= {name: float(found[name].median()) for name in MEDIANS if len(found[name])}
        return figures | (
            {"planes_found": float((errors < HIT).float().mean())} if len(errors) else {}
        )


def _angle_deg(direction: Tensor, truth: Tensor) -> Tensor:
    """Return angles (n,) in degrees between lines (n, 3)."""
    # The cosine alone would have rounding errors of a third of a degree near zero.
    sine = torch.linalg.cross(direction, truth).square().sum(-1).sqrt()
    return torch.rad2deg(torch.atan2(sine, (direction * truth).sum(-1).abs()))


def area_under_roc(
    values: Tensor,  # (n,)
    positive: Tensor,  # (n,) bool
) -> float:
    """Return the share of pairs whose positive has the higher value; equal values count half.

    0.5 if there is no positive or no negative.
    """
    positives = int(positive.sum())
    negatives = len(positive) - positives
    if not positives or not negatives:
        return 0.5
    from scipy.stats import rankdata  # noqa: PLC0415 - slow to import

    ranks = rankdata(values.cpu().numpy())  # equal values share their mean rank
    surplus = float(ranks[positive.cpu().numpy()].sum()) - positives * (positives + 1) / 2
    return surplus / (positives * negatives)


def mean_symmetries(prediction: Prediction) -> tuple[Tensor, Tensor, Tensor]:
    """Return existence (B, 5), points (B, 5, 3) and directions (B, 5, 3), averaged as by `infer`.

    Existence is a probability; frame and unit are the prediction's; a sphere's direction is nan.
    """
    columns = torch.sigmoid(prediction.existence), prediction.center, prediction.direction
    votes = zip(*(each[:, ::VOTING_STRIDE].cpu().numpy() for each in columns), strict=True)
    regions = [mean_slots(*each) for each in votes]
    means = zip(*((r.probability, r.point, r.direction) for r in regions), strict=True)
    existence, point, direction = (
        torch.from_numpy(np.stack(each)).to(prediction.center) for each in means
    )
    return existence, point, direction
