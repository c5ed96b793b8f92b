"""Success rates with Wilson's intervals."""

from typing import Any

LEVEL = 0.95  # of the interval


def success_rate(trials: int, held: int) -> dict[str, Any]:
    """Return the `rate` of `held` in `trials`, with the interval `low` to `high` (Wilson, 1927).

    All three are None without trials. Unlike the normal approximation, this interval stays within
    0 to 1, and is valid for no or only successes.
    """
    rate = low = high = None
    if trials:
        from scipy.stats import binomtest  # noqa: PLC0415 - slow to import

        found = binomtest(held, trials).proportion_ci(LEVEL, method="wilson")
        rate, low, high = held / trials, float(found.low), float(found.high)
    return {"trials": trials, "held": held, "rate": rate, "low": low, "high": high}
