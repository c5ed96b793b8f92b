"""Stand-ins for the networks: a detector of a frame, a predictor of a region."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Detection:
    """A region that a detector found."""

    mask: np.ndarray
    confidence: float = 0.9


@dataclass(frozen=True)
class Examined:
    """A frame with the given detections; `rate` rates a box."""

    detections: list
    rate: Callable

    def confidences(self, boxes):
        return np.array([self.rate(box) for box in boxes])


@dataclass(frozen=True)
class Detector:
    """Finds the given regions, and remembers the planes that it was given; other boxes: `rate`."""

    found: list
    planes: list = field(default_factory=list)
    rate: Callable = lambda box: 0.9

    def examine(self, color, depth, intrinsics, plane):
        self.planes.append(plane)
        return Examined(self.found, self.rate)


@dataclass(frozen=True)
class Prediction:
    """The fields of `RegionPrediction`."""

    index: np.ndarray
    affordance: np.ndarray
    existence: np.ndarray
    center: np.ndarray
    direction: np.ndarray
