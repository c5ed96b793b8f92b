"""The measured steps of the networks, each run once and without a clock."""

import pytest

from benchmarks import bench_network


@pytest.fixture
def no_clock(monkeypatch):
    def run_once(step, repeats=1):
        step()
        return 1.0

    monkeypatch.setattr(bench_network, "cpu_seconds_of", run_once)
    monkeypatch.setattr(bench_network, "SIDE", 16)
    monkeypatch.setattr(bench_network, "NUM_REGIONS", 2)
    monkeypatch.setattr(bench_network, "MICRO_BATCH", 2)


@pytest.mark.usefixtures("no_clock")
def test_networks_and_the_training_step_are_measured():
    found = bench_network.measure()
    assert [each.value for each in found] == [1.0] * 4
    assert all("times the floor" in each.note for each in found[:3])
