"""Logistic regressions: the critic of axes and spheres, and calibrations of other critics."""

import numpy as np
from scipy.special import expit

from pipelines.array_types import Array, Floats, Indices
from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.grasping.symmetries.axis_critic import AxisCritic
from pipelines.learning.critics.critic_rows import CriticRows

RIDGE = 1.0  # penalty on slopes of standardised columns; chosen by eye
STEPS = 50  # steps of Newton's method
ROUNDS = 20  # fits to the axes that the previous fit chooses; a few suffice


def logistic_regression(columns: Floats, truth: Floats) -> Array:
    """Return constant and slopes (1 + f,) of a ridge regression of `truth` (n,) on (n, f)."""
    centre, scale = columns.mean(axis=0), np.maximum(columns.std(axis=0), 1e-9)
    rows = np.column_stack([np.ones(len(columns)), (columns - centre) / scale]).astype(np.float64)
    ridge = np.full(rows.shape[1], RIDGE)
    ridge[0] = 0.0
    weights = np.zeros(rows.shape[1])
    for _ in range(STEPS):
        share = expit(rows @ weights)
        curvature = (rows * (share * (1.0 - share))[:, None]).T @ rows + np.diag(ridge)
        slope = rows.T @ (truth - share) - ridge * weights
        weights = weights + np.linalg.solve(curvature, slope)
    slopes = weights[1:] / scale
    return np.concatenate([[weights[0] - slopes @ centre], slopes])


def log_loss(log_odds: Array, truth: Array) -> float:
    """Return the mean cross-entropy of `truth` (n,), 0 to 1, given `log_odds` (n,)."""
    return float(np.mean(np.logaddexp(0.0, log_odds) - truth * log_odds))


def fit_axis_critic(rows: CriticRows) -> AxisCritic:
    """Return the regressions of axes and spheres.

    `infer` uses only the most likely axis of each region, so each round fits to the axes that the
    previous fit prefers, until this choice stays the same. The first round takes the axis with the
    most consistent images.

    Raises:
        ValueRangeError: there are no true, or no false, axes or spheres.
    """
    rotation, sphere = (rows[rows.slot == slot] for slot in (ROTATION_SLOT, SPHERE_SLOT))
    for name, part in (("axes", rotation), ("spheres", sphere)):
        if not 0.0 < (part.truth.mean() if len(part) else 0.0) < 1.0:
            found = f"{int(part.truth.sum())} of {len(part)} are true"
            raise ValueRangeError(f"candidate {name}", found, "some true and some false")
    regression = logistic_regression(sphere.candidates.astype(np.float64), sphere.truth)
    critic = AxisCritic(np.array([0.0, 0.0, 0.0, 1.0]), regression)
    before: Indices | None = None
    for _ in range(ROUNDS):
        scores = critic.log_odds("rotation", rotation.candidates.astype(np.float64))
        chosen = best_of_groups(scores, rotation.group)
        if before is not None and np.array_equal(chosen, before):
            break
        best, before = rotation[chosen], chosen
        weights = logistic_regression(best.candidates.astype(np.float64), best.truth)
        critic = AxisCritic(weights, regression)
    return critic


def best_of_groups(scores: Array, group: Indices) -> Indices:
    """Return the index of the highest of `scores` (n,) in each `group` (n,), the first if equal."""
    order = np.lexsort((np.arange(len(scores)), -scores, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    return order[first]
