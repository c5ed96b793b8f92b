"""Rates of success with Wilson's intervals: how sure so many trials make one."""

from dataclasses import dataclass

import numpy as np

from pipelines.errors import ValueRangeError

NORMAL_95 = 1.959963984540054  # that a normal variable stays below in 97.5 % of all cases


@dataclass(frozen=True)
class SuccessRate:
    """`held` of `trials`; rate and 95 % interval are None without trials."""

    trials: int
    held: int

    def __post_init__(self) -> None:
        if not 0 <= self.held <= self.trials:
            raise ValueRangeError("successes", self.held, f"0 to the {self.trials} trials")

    @property
    def rate(self) -> float | None:
        """Share of the trials that held."""
        return self.held / self.trials if self.trials else None

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Lowest and highest rate that 95 % confidence leaves (Wilson, 1927).

        Unlike the textbook's interval it stays within 0 to 1, and means something for no or only
        successes.
        """
        if not self.trials:
            return None, None
        n, p, z = self.trials, self.held / self.trials, NORMAL_95
        middle = p + z * z / (2 * n)
        half = z * float(np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)))
        scale = 1 + z * z / n
        # Rounding may miss the ends by a bit, and 0 of n must not exclude 0.
        low = 0.0 if self.held == 0 else (middle - half) / scale
        high = 1.0 if self.held == n else (middle + half) / scale
        return low, high
