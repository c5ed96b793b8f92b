"""The machine's rate of matrix products, for comparison with other figures."""

import os
from functools import lru_cache

import numpy as np

from benchmarks.timing import Measurement, seconds_of

SIDE = 2048


def measure() -> list[Measurement]:
    """Return the rate of single-precision matrix products."""
    busy = os.getloadavg()[0]  # other work on the machine makes every figure worse
    note = f"{SIDE} x {SIDE}, {os.cpu_count()} cores, load {busy:.1f} at the start"
    return [Measurement("SGEMM", sgemm_rate(), "GFLOP/s", note)]


@lru_cache(maxsize=1)
def sgemm_rate() -> float:
    """Return billions of operations per second."""
    a, b = np.random.default_rng(0).random((2, SIDE, SIDE), np.float32)
    return 2.0 * SIDE**3 / 1e9 / seconds_of(lambda: a @ b)
