"""Network over the points of a candidate: the probability that the candidate is correct.

The axis critic (D. 148), the plane critic (D. 80) and the grasp critic (D. 82) are such networks.
Each point goes through shared layers; the maximum and the mean over the points go through further
layers, together with numbers of the candidate itself. `symgrasp train-critic` learns the weights.

`PointCritic.logits` defines the network once, for arrays of numpy and for tensors of torch.
`PointCritic.fast_logits` is equal, for inference: compiled, without copies of shared features.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
from scipy.special import expit

from pipelines.array_types import Array, Singles
from pipelines.geometry.numerics.compiled import compiled

Numbers = Any  # an array of numpy or a tensor of torch, the same for all arguments of a call

POINT_WIDTHS, LAST_WIDTHS = (64, 64, 96), (64, 32, 1)  # chosen by eye
CHUNK = 16  # candidates at a time, so that hidden rows of points stay in the cache


@dataclass(frozen=True)
class FeatureNames:
    """Names of a critic's inputs, in the order of their columns.

    Attributes:
        point: features of each point of a candidate.
        shared: features of the candidate, input of each point and of the last layers.
        candidate: features of the candidate, input of the last layers only, standardised.
    """

    point: tuple[str, ...]
    shared: tuple[str, ...]
    candidate: tuple[str, ...]

    def as_text(self) -> str:
        """Return the names as JSON, for the metadata of a weights file."""
        return json.dumps(vars(self))

    def weight_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of each of the network's weights by name."""
        point, shared, candidate = len(self.point), len(self.shared), len(self.candidate)
        joined = 2 * POINT_WIDTHS[-1] + candidate + shared
        layers = {"point": (point + shared, *POINT_WIDTHS), "last": (joined, *LAST_WIDTHS)}
        shapes: dict[str, tuple[int, ...]] = {}
        for name, widths in layers.items():
            for index, (wide, narrow) in enumerate(pairwise(widths)):
                shapes[f"{name}.{index}.weight"] = narrow, wide
                shapes[f"{name}.{index}.bias"] = (narrow,)
        return shapes | {"mean": (candidate,), "spread": (candidate,), "calibration": (2,)}


@dataclass(frozen=True)
class PointCritic:
    """The network: names of its inputs, and its weights.

    Attributes:
        features: names of the inputs.
        weights: named as in `FeatureNames.weight_shapes`. `point.N` and `last.N` are linear
            layers with ReLU between them; `mean` and `spread` (c,) standardise the candidate's
            features; `calibration` (a, b): a + b l are the log odds of logits l on new objects.
    """

    features: FeatureNames
    weights: Mapping[str, Numbers]

    def logits(
        self,
        points: Numbers,  # (k, n, p)
        shared: Numbers,  # (k, s); s may be 0
        candidates: Numbers,  # (k, c)
        xp: ModuleType = np,
        dropout: Callable[[Numbers], Numbers] | None = None,
    ) -> Numbers:
        """Return logits (k,) by `xp`, the module of the arguments, numpy or torch.

        `dropout`: applied to the output of the first of the last layers, in training.
        """
        spread = xp.zeros_like(points[..., :1]) + shared[:, None]  # (k, n, s)
        hidden = xp.concatenate([points, spread], -1)
        for index in range(len(POINT_WIDTHS)):
            hidden = self._layer(f"point.{index}", hidden.clip(0.0, None) if index else hidden)
        standard = (candidates - self.weights["mean"]) / self.weights["spread"]
        joined = xp.concatenate([xp.amax(hidden, 1), hidden.mean(1), standard, shared], -1)
        for index in range(len(LAST_WIDTHS)):
            joined = self._layer(f"last.{index}", joined.clip(0.0, None) if index else joined)
            if index == 0 and dropout is not None:
                joined = dropout(joined)
        return joined[:, 0]

    def _layer(self, name: str, rows: Numbers) -> Numbers:
        return rows @ self.weights[f"{name}.weight"].T + self.weights[f"{name}.bias"]

    def probability(self, points: Singles, shared: Singles, candidates: Singles) -> Array:
        """Return the probability (k,) that candidates are correct, or the expected quality.

        Arguments as those of `logits`.
        """
        bias, slope = self.weights["calibration"].astype(np.float64)
        return np.asarray(expit(bias + slope * self.fast_logits(points, shared, candidates)))

    def fast_logits(self, points: Singles, shared: Singles, candidates: Singles) -> Singles:
        """Return the result (k,) of `logits`, up to rounding, in less time; arguments as there."""
        parts = [slice(start, start + CHUNK) for start in range(0, max(1, len(points)), CHUNK)]
        pooled = [self._pooled(points[part], shared[part]) for part in parts]
        standard = (candidates - self.weights["mean"]) / self.weights["spread"]
        joined = np.concatenate([np.concatenate(pooled), standard, shared], axis=1)
        for index in range(len(LAST_WIDTHS)):
            joined = self._layer(f"last.{index}", np.maximum(joined, 0.0) if index else joined)
        return np.asarray(joined[:, 0], np.float32)

    def _pooled(self, points: Singles, shared: Singles) -> Singles:
        """Return maximum and mean (k, 2 c) of the last hidden rows of the points."""
        # The first layer is a sum: the part of shared features is computed once per candidate.
        weight, bias = self.weights["point.0.weight"], self.weights["point.0.bias"]
        split = points.shape[-1]
        hidden = points.reshape(-1, split) @ weight[:, :split].T
        offset = shared @ weight[:, split:].T + bias
        for index in range(1, len(POINT_WIDTHS)):
            _rectify(hidden.reshape(*points.shape[:2], offset.shape[1]), offset)
            hidden = hidden @ self.weights[f"point.{index}.weight"].T
            offset = self.weights[f"point.{index}.bias"][None]
        return _largest_and_mean(hidden.reshape(*points.shape[:2], offset.shape[1]), offset[0])


@compiled
def _rectify(rows: Singles, offset: Singles) -> None:
    """Add `offset` (k or 1, c) to `rows` (k, n, c) and clip them at zero."""
    for k in range(rows.shape[0]):
        which = min(k, len(offset) - 1)
        for n in range(rows.shape[1]):
            for c in range(rows.shape[2]):
                rows[k, n, c] = max(rows[k, n, c] + offset[which, c], np.float32(0.0))


@compiled
def _largest_and_mean(rows: Singles, offset: Singles) -> Singles:
    """Return maximum and mean (k, 2 c) of n `rows` (k, n, c) plus `offset` (c,)."""
    pooled = np.empty((rows.shape[0], 2 * rows.shape[2]), np.float32)
    largest, mean = pooled[:, : rows.shape[2]], pooled[:, rows.shape[2] :]
    largest[:], mean[:] = -np.inf, 0.0
    for k in range(rows.shape[0]):
        for n in range(rows.shape[1]):
            for c in range(rows.shape[2]):
                largest[k, c] = max(largest[k, c], rows[k, n, c])
                mean[k, c] += rows[k, n, c]
        for c in range(rows.shape[2]):
            largest[k, c] += offset[c]
            mean[k, c] = mean[k, c] / np.float32(rows.shape[1]) + offset[c]
    return pooled
