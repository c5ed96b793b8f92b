"""Figures of a grasp network on labelled regions, by which training is validated."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import torch
from scipy.stats import rankdata
from torch import Tensor

from pipelines.configs import EvaluateConfig
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.network.averaging import average_symmetries
from pipelines.network.dense_error import reflection_errors, reflection_extent
from pipelines.network.losses import symmetry_weights
from pipelines.network.matching import NUM_REFLECTIONS, match_reflections
from pipelines.network.model import Prediction
from pipelines.network.regions import RegionBatch

GRASPABLE = 0.5  # affordance above which a point is grasped (Sec. III-E)
HIT = EvaluateConfig.symmetry_thresholds[0]  # dense error below which a plane is found, D. 11
NUM_FIGURE_POINTS = 64  # of a region, on which dense errors are measured; chosen by eye


@dataclass
class RegionFigures:
    """Errors of predictions on labelled regions, collected batch by batch."""

    affordance: list[Tensor] = field(default_factory=list)
    true_affordance: list[Tensor] = field(default_factory=list)
    existence_right: list[Tensor] = field(default_factory=list)
    plane_angle: list[Tensor] = field(default_factory=list)
    plane_error: list[Tensor] = field(default_factory=list)
    axis_angle: list[Tensor] = field(default_factory=list)
    sphere_offset: list[Tensor] = field(default_factory=list)

    @torch.no_grad()
    def add(self, prediction: Prediction, truth: RegionBatch) -> None:
        """Add the predictions for all points of one batch."""
        points = truth.points[:, :: max(1, truth.points.shape[1] // NUM_FIGURE_POINTS)]
        weight = symmetry_weights(prediction.affordance)
        directions, centers = prediction.direction[:, :, :3], prediction.center[:, :, :3]
        truth = match_reflections(truth, points, directions, centers, weight)
        existence, means, lines = average_symmetries(prediction, weight)
        self.affordance.append(prediction.affordance.flatten())
        self.true_affordance.append(truth.affordance.flatten())
        self.existence_right.append((existence > 0.5) == (truth.existence > 0.5))
        for slot in range(NUM_REFLECTIONS):
            rows = truth.existence[:, slot] > 0
            normal, center = truth.direction[rows, slot], truth.center[rows, slot]
            self.plane_angle.append(_angle_deg(lines[rows, slot], normal))
            error = reflection_errors(
                points[rows],
                lines[rows, slot, None],
                means[rows, slot, None],
                normal,
                center,
            )
            self.plane_error.append(error[:, 0] / reflection_extent(points[rows], normal, center))
        rows = truth.existence[:, ROTATION_SLOT] > 0
        axis = truth.direction[rows, ROTATION_SLOT]
        self.axis_angle.append(_angle_deg(lines[rows, ROTATION_SLOT], axis))
        rows = truth.existence[:, SPHERE_SLOT] > 0
        offset = means[rows, SPHERE_SLOT] - truth.center[rows, SPHERE_SLOT]
        self.sphere_offset.append(offset.norm(dim=-1))

    def figures(self) -> dict[str, float]:
        """Return the figures by name: degrees, metres, shares; kinds without truth are left out."""
        affordance, truth = torch.cat(self.affordance), torch.cat(self.true_affordance)
        right = torch.cat(self.existence_right).float().mean(0)
        figures = {
            "affordance_mae": float((affordance.clamp(0, 1) - truth).abs().mean()),
            "affordance_auc": area_under_roc(affordance, truth > GRASPABLE),
            "existence_accuracy": float(right.mean()),
            "reflection_accuracy": float(right[:NUM_REFLECTIONS].mean()),
            "rotation_accuracy": float(right[ROTATION_SLOT]),
            "sphere_accuracy": float(right[SPHERE_SLOT]),
        }
        medians = {
            "plane_angle_deg": self.plane_angle,
            "plane_dense_error": self.plane_error,
            "axis_angle_deg": self.axis_angle,
            "sphere_offset_m": self.sphere_offset,
        }
        for name, parts in medians.items():
            figures |= _median(name, parts)
        errors = torch.cat(self.plane_error)
        return figures | (
            {"planes_found": float((errors < HIT).float().mean())} if len(errors) else {}
        )


def _median(name: str, parts: Iterable[Tensor]) -> dict[str, float]:
    values = torch.cat(list(parts))
    return {name: float(values.median())} if len(values) else {}


def _angle_deg(direction: Tensor, truth: Tensor) -> Tensor:
    """Return angles (n,) in degrees between lines (n, 3)."""
    # Not the cosine alone: near zero it leaves a third of a degree to rounding.
    sine = torch.linalg.cross(direction, truth).square().sum(-1).sqrt()
    return torch.rad2deg(torch.atan2(sine, (direction * truth).sum(-1).abs()))


def area_under_roc(
    values: Tensor,  # (n,)
    positive: Tensor,  # (n,) bool
) -> float:
    """Return the share of pairs in which the positive has the higher value, equal ones as half.

    0.5 if there is no positive or no negative.
    """
    positives = int(positive.sum())
    negatives = len(positive) - positives
    if not positives or not negatives:
        return 0.5
    ranks = rankdata(values.cpu().numpy())  # equals share the mean of their ranks
    surplus = float(ranks[positive.cpu().numpy()].sum()) - positives * (positives + 1) / 2
    return surplus / (positives * negatives)
