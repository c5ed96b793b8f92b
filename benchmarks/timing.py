"""Measurements: timing and printing."""

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Measurement:
    """One line of the table; `value` is None if a requirement is missing."""

    what: str
    value: float | None
    unit: str
    note: str = ""


def seconds_of(step: Callable[[], object], repeats: int = 3) -> float:
    """Return the median wall-clock seconds of `step`, after one call that warms caches."""
    return _median(step, repeats, time.perf_counter)


def cpu_seconds_of(step: Callable[[], object], repeats: int = 3) -> float:
    """Return the median processor seconds of `step`, all threads together."""
    return _median(step, repeats, time.process_time)


def _median(step: Callable[[], object], repeats: int, clock: Callable[[], float]) -> float:
    step()
    taken = []
    for _ in range(repeats):
        started = clock()
        step()
        taken.append(clock() - started)
    return statistics.median(taken)


def markdown(measurements: Iterable[Measurement]) -> str:
    """Return the measurements as a Markdown table."""
    lines = ["| what | value | unit | note |", "|---|---:|---|---|"]
    lines += [f"| {m.what} | {_number(m.value)} | {m.unit} | {m.note} |" for m in measurements]
    return "\n".join(lines) + "\n"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
