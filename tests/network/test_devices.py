"""Devices by name."""

import pytest
import torch

from pipelines.errors import UnknownNameError, ValueRangeError
from pipelines.network.devices import find_device


def test_auto_is_a_gpu_where_there_is_one():
    assert find_device("auto").type == ("cuda" if torch.cuda.is_available() else "cpu")


@pytest.mark.parametrize("name", ["tpu", "cpu:x", "cuda:-1"])
def test_an_unknown_device_is_refused(name):
    with pytest.raises(UnknownNameError):
        find_device(name)


def test_a_gpu_that_is_not_there_is_refused():
    with pytest.raises(ValueRangeError):
        find_device("cuda:99")
