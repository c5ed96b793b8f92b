"""Learning rate of a training that lasts a given time, or so many steps."""

import math
from dataclasses import dataclass

WARM_UP_STEPS = 300
SMALLEST_RATE = 1e-6


@dataclass(frozen=True)
class Schedule:
    """How fast weights change: a warm-up, then half a cosine over the time there is.

    Attributes:
        rate: the largest.
        seconds: there are.
        averaged: of the mean of the weights, that is kept in a step.
        drops: the rate falls by a tenth so many times instead (Sec. III-G); 0 for the cosine.
        steps: after which it ends if they are made before.
    """

    rate: float
    seconds: float
    averaged: float
    drops: int = 0
    steps: int = 10**9

    def rate_at(self, step: int, seconds: float) -> float:
        """Return the learning rate."""
        share = min(1.0, max(seconds / self.seconds, step / self.steps))
        if self.drops:
            return self.rate * 0.9 ** int(self.drops * share)
        cosine = 0.5 + 0.5 * math.cos(math.pi * share)
        return self.rate * min(1.0, (step + 1) / WARM_UP_STEPS) * cosine + SMALLEST_RATE
