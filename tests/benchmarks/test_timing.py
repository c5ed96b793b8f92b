"""The table that `python -m benchmarks` prints."""

import time

from benchmarks.timing import Measurement, cpu_seconds_of, markdown, seconds_of


def test_a_measurement_is_printed_as_one_line():
    table = markdown([Measurement("pack", 12.345, "frames/s", "one process")])
    assert table.splitlines()[-1] == "| pack | 12.3 | frames/s | one process |"


def test_a_missing_measurement_is_shown_as_a_dash():
    assert "| infer | - |" in markdown([Measurement("infer", None, "s/frame", "no weights")])


def test_large_numbers_are_shown_without_decimals():
    assert "| 1,234,568 |" in markdown([Measurement("grasps scored", 1234567.8, "1/s")])


def test_a_step_is_run_once_before_it_is_timed():
    calls: list[int] = []
    assert seconds_of(lambda: calls.append(1), repeats=3) >= 0.0
    assert len(calls) == 4


def test_no_cpu_time_is_counted_while_a_step_sleeps():
    assert cpu_seconds_of(lambda: time.sleep(0.05), repeats=1) < 0.05
