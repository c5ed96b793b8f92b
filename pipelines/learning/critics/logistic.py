"""Logistic regression for the calibration of critics, and the choice of the best of a group."""

import numpy as np
from scipy.special import expit

from pipelines.array_types import Array, Floats, Indices

RIDGE = 1.0  # penalty on slopes of standardised columns; chosen by eye
STEPS = 50  # steps of Newton's method


def logistic_regression(columns: Floats, truth: Floats) -> Array:
    """Return constant and slopes (1 + f,) of a ridge regression of `truth` (n,) on (n, f)."""
    center, scale = columns.mean(axis=0), np.maximum(columns.std(axis=0), 1e-9)
    rows = np.column_stack([np.ones(len(columns)), (columns - center) / scale]).astype(np.float64)
    ridge = np.full(rows.shape[1], RIDGE)
    ridge[0] = 0.0
    weights = np.zeros(rows.shape[1])
    for _ in range(STEPS):
        share = expit(rows @ weights)
        curvature = (rows * (share * (1.0 - share))[:, None]).T @ rows + np.diag(ridge)
        slope = rows.T @ (truth - share) - ridge * weights
        weights = weights + np.linalg.solve(curvature, slope)
    slopes = weights[1:] / scale
    return np.concatenate([[weights[0] - slopes @ center], slopes])


def log_loss(log_odds: Array, truth: Array) -> float:
    """Return the mean cross-entropy of `truth` (n,), 0 to 1, given `log_odds` (n,)."""
    return float(np.mean(np.logaddexp(0.0, log_odds) - truth * log_odds))


def best_of_groups(scores: Array, group: Indices) -> Indices:
    """Return the index of the highest of `scores` (n,) in each `group` (n,), the first if equal."""
    order = np.lexsort((np.arange(len(scores)), -scores, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    return order[first]
