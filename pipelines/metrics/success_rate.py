"""Rates of success with Wilson's intervals."""

from dataclasses import dataclass

LEVEL = 0.95  # of the interval


@dataclass(frozen=True)
class SuccessRate:
    """`held` of `trials`; rate and 95 % interval are None without trials."""

    trials: int
    held: int

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
        from scipy.stats import binomtest  # noqa: PLC0415 - slow to import

        found = binomtest(self.held, self.trials).proportion_ci(LEVEL, method="wilson")
        return float(found.low), float(found.high)
