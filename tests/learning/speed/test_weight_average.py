"""The running mean of weights: its device, and its independence of the loaded state."""

import torch
from torch import nn

from pipelines.learning.speed.weight_average import WeightAverage


def test_a_mean_that_was_read_on_the_cpu_moves_to_the_device_of_the_weights():
    saved = WeightAverage(nn.Linear(2, 2), 0.9).state()
    average = WeightAverage(nn.Linear(2, 2, device="meta"), 0.9)
    average.load(saved)
    assert {tensor.device.type for tensor in average.state().values()} == {"meta"}


def test_a_loaded_mean_is_a_copy():
    average = WeightAverage(nn.Linear(2, 2), 0.9)
    state = average.state()
    before = {name: tensor.clone() for name, tensor in state.items()}
    average.load(state)
    with torch.no_grad():
        average.module.weight.add_(1.0)
    average.update(1)
    assert all(torch.equal(tensor, before[name]) for name, tensor in state.items())
