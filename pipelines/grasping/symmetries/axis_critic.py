"""Critic of fitted axes and spheres: logistic regressions on three numbers (D. 31)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from pipelines.array_types import Array

FEATURES = ("existence", "support", "consistency")  # columns of a fit's evidence, each 0 to 1
KINDS = ("rotation", "sphere")


@dataclass(frozen=True)
class AxisCritic:
    """The regressions' weights: (4,) each, a constant and one slope for each of `FEATURES`."""

    rotation: Array
    sphere: Array

    def log_odds(self, kind: str, evidence: Sequence[float] | Array) -> Array:
        """Return the log odds (...) that symmetries of a `kind` with `evidence` (..., 3) exist."""
        constant, *slopes = self.rotation if kind == "rotation" else self.sphere
        total = constant
        for column, slope in enumerate(slopes):
            total = total + slope * np.asarray(evidence, np.float64)[..., column]
        return np.asarray(total)

    def probability(self, kind: str, evidence: Sequence[float] | Array) -> Array:
        """Return the probability (...) that symmetries of a `kind` with `evidence` exist."""
        return np.asarray(expit(self.log_odds(kind, evidence)))
