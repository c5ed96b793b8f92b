"""Rates of success with Wilson's intervals."""

from typing import Any

LEVEL = 0.95  # of the interval


def success_rate(trials: int, held: int) -> dict[str, Any]:
    """Return `held` of `trials` as `rate`, with the interval `low` to `high` (Wilson, 1927).

    All three are None without trials. Unlike the textbook's interval it stays within 0 to 1, and
    means something for no or only successes.
    """
    rate = low = high = None
    if trials:
        from scipy.stats import binomtest  # noqa: PLC0415 - slow to import

        found = binomtest(held, trials).proportion_ci(LEVEL, method="wilson")
        rate, low, high = held / trials, float(found.low), float(found.high)
    return {"trials": trials, "held": held, "rate": rate, "low": low, "high": high}
