"""Learning rate of a training with a given time or number of steps."""

import math
from dataclasses import dataclass

WARM_UP_STEPS = 300
SMALLEST_RATE = 1e-6


@dataclass(frozen=True)
class Schedule:
    """Learning rate over time: a warm-up, then half a cosine over the given time.

    Attributes:
        rate: largest learning rate.
        seconds: time of the training.
        averaged: share of the mean weights that a step keeps.
        drops: number of drops by a tenth, in place of the cosine (Sec. III-G); 0 for the cosine.
        steps: number of steps that also ends the training, if it is reached earlier.
    """

    rate: float
    seconds: float
    averaged: float
    drops: int = 0
    steps: int = 10**9

    def rate_at(self, step: int, seconds: float) -> float:
        """Return the learning rate at `step`, `seconds` after the start."""
        share = min(1.0, max(seconds / self.seconds, step / self.steps))
        if self.drops:
            return self.rate * 0.9 ** int(self.drops * share)
        cosine = 0.5 + 0.5 * math.cos(math.pi * share)
        return self.rate * min(1.0, (step + 1) / WARM_UP_STEPS) * cosine + SMALLEST_RATE
