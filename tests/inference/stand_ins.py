"""Stand-ins for the networks: a detector of a frame, a predictor of a region."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Detection:
    """A region that a detector found."""

    mask: np.ndarray
    confidence: float = 0.9


@dataclass(frozen=True)
class Detector:
    """Finds the given regions, and remembers the planes that it was given."""

    found: list
    planes: list = field(default_factory=list)

    def detect(self, color, depth, intrinsics, plane):
        self.planes.append(plane)
        return self.found


@dataclass(frozen=True)
class Prediction:
    """The fields of `RegionPrediction`."""

    index: np.ndarray
    affordance: np.ndarray
    existence: np.ndarray
    center: np.ndarray
    direction: np.ndarray
