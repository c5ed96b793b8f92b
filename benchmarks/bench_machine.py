"""What the machine can do: the rate that everything else is compared with."""

import os

import numpy as np

from benchmarks.timing import Measurement, seconds_of

SIDE = 2048


def measure() -> list[Measurement]:
    """Return the rate of single-precision matrix products."""
    rng = np.random.default_rng(0)
    a, b = rng.random((2, SIDE, SIDE), np.float32)
    gflop = 2.0 * SIDE**3 / 1e9
    busy = os.getloadavg()[0]  # other work on the machine makes every figure worse
    note = f"{SIDE} x {SIDE}, {os.cpu_count()} cores, load {busy:.1f} at the start"
    return [Measurement("SGEMM", gflop / seconds_of(lambda: a @ b), "GFLOP/s", note)]
