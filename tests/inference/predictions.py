"""What stand-ins for the network say of a region."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Prediction:
    """As `RegionPrediction`, and nothing more."""

    index: np.ndarray
    affordance: np.ndarray
    telling: np.ndarray
    existence: np.ndarray
    center: np.ndarray
    direction: np.ndarray
