"""A small network over points that says how likely a candidate is a good one.

Points as a candidate sees them go through shared layers, their maximum and mean through further
ones, beside numbers about the candidate. One of these critics mirror planes (D. 80), another hands
(D. 82); they are trained by `tools/train_plane_critic.py` and `tools/train_grasp_critic.py`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from pipelines.geometry.numerics.compiled import compiled

Rows = NDArray[np.float32]
Layer = tuple[Rows, Rows]  # weight (out, in), bias (out,)

POINT_LAYERS, LAST_LAYERS = 3, 3
CHUNK = 16  # candidates at a time: what the layers make of their points stays near the processor


@dataclass(frozen=True)
class PointCritic:
    """The network's weights.

    Attributes:
        point_layers: for each point, ReLU between them.
        last_layers: for what all points give, ReLU between them; one number out.
        mean: (e,) of the evidence.
        spread: (e,) of the same.
        calibration: (2,) a, b: of logits l, a + b l are the log odds on objects never seen.
    """

    point_layers: tuple[Layer, ...]
    last_layers: tuple[Layer, ...]
    mean: Rows
    spread: Rows
    calibration: Rows

    @property
    def widths(self) -> tuple[int, int]:
        """How many numbers it takes of a point, with what all points share, and as evidence."""
        return self.point_layers[0][0].shape[1], len(self.mean)

    def logits(
        self,
        points: Rows,  # (k, n, p)
        wholes: Rows,  # (k, w) what every point of a candidate shares; w may be 0
        evidence: Rows,  # (k, e)
    ) -> Rows:
        """Return the network's logits (k,)."""
        parts = [slice(start, start + CHUNK) for start in range(0, max(1, len(points)), CHUNK)]
        pooled = [self._pooled(points[part], wholes[part]) for part in parts]
        known = (evidence - self.mean) / self.spread
        joined = np.concatenate([np.concatenate(pooled), known, wholes], axis=1)
        for index, (weight, bias) in enumerate(self.last_layers):
            joined = (np.maximum(joined, 0.0) if index else joined) @ weight.T + bias
        return np.asarray(joined[:, 0], np.float32)

    def _pooled(self, points: Rows, wholes: Rows) -> Rows:
        """Return (k, 2 c) the largest and the mean of what the first layers make of each point."""
        # The first layer's product is a sum: what a whole candidate shares is multiplied once.
        weight, bias = self.point_layers[0]
        split = points.shape[-1]
        hidden = points.reshape(-1, split) @ weight[:, :split].T
        offset = wholes @ weight[:, split:].T + bias
        for weight, bias in self.point_layers[1:]:
            _rectify(hidden.reshape(*points.shape[:2], offset.shape[1]), offset)
            hidden, offset = hidden @ weight.T, bias[None]
        return _largest_and_mean(hidden.reshape(*points.shape[:2], offset.shape[1]), offset[0])

    def trust(
        self,
        points: Rows,  # (k, n, p)
        wholes: Rows,  # (k, w)
        evidence: Rows,  # (k, e)
    ) -> NDArray[np.float64]:
        """Return the probability (k,) that candidates are good, or the quality to expect."""
        bias, slope = self.calibration.astype(np.float64)
        return np.asarray(expit(bias + slope * self.logits(points, wholes, evidence)))

    @classmethod
    def of(cls, arrays: Mapping[str, Rows]) -> "PointCritic":
        """Return the critic whose `arrays` are named as in its file (formats.md)."""

        def layers(name: str, count: int) -> tuple[Layer, ...]:
            parts = ((f"{name}.{i}.weight", f"{name}.{i}.bias") for i in range(count))
            return tuple((arrays[weight], arrays[bias]) for weight, bias in parts)

        return cls(
            layers("point", POINT_LAYERS),
            layers("last", LAST_LAYERS),
            *(arrays[name] for name in ("mean", "spread", "calibration")),
        )


@compiled
def _rectify(rows: Rows, offset: Rows) -> None:
    """Add `offset` (k or 1, c) to `rows` (k, n, c), and cut off what is below zero."""
    for k in range(rows.shape[0]):
        which = min(k, len(offset) - 1)
        for n in range(rows.shape[1]):
            for c in range(rows.shape[2]):
                rows[k, n, c] = max(rows[k, n, c] + offset[which, c], np.float32(0.0))


@compiled
def _largest_and_mean(rows: Rows, offset: Rows) -> Rows:
    """Return (k, 2 c) the largest and the mean of n `rows` (k, n, c) plus `offset` (c,)."""
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
