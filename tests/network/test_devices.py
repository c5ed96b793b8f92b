"""Devices by name."""

import pytest
import torch

from pipelines.errors import UnknownNameError, ValueRangeError
from pipelines.network.devices import find_device


def test_auto_is_a_gpu_where_there_is_one():
    assert find_device("auto").type == ("cuda" if torch.cuda.is_available() else "cpu")


@pytest.mark.parametrize(
    "name",
    [
        "tpu",
        "cpu:x",
        "cpu:",
        "cpu:0",
        "cpu:1",
        "cuda:",
        "cuda:-1",
        "cuda:01",
        "cuda:\u0661",
    ],
)
def test_an_unknown_device_is_refused(name):
    with pytest.raises(UnknownNameError):
        find_device(name)


def test_a_missing_gpu_is_refused():
    with pytest.raises(ValueRangeError, match=r"cuda:99; it must be cpu.* on this machine"):
        find_device("cuda:99")


def test_each_process_has_a_separate_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert find_device("auto", 2) == find_device("cuda", 2) == torch.device("cuda:2")
    assert find_device("cpu", 2) == torch.device("cpu")
    assert find_device("cuda:1", 2) == torch.device("cuda:1")
    with pytest.raises(ValueRangeError, match="cuda:4"):
        find_device("cuda", 4)
