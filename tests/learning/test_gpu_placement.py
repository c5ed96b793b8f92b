"""The code for GPUs, tested without one: on the CPU, and with tensors without numbers.

Such tensors claim to be on a GPU that need not exist, and raise an error with a tensor elsewhere.
Gradients are checked on the CPU instead, as autograd needs the device itself.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils._python_dispatch import _disable_current_modes

from pipelines.learning.grasp_network.grasp_training import Sample, augmented, sample_loss
from pipelines.network import devices
from pipelines.network.cpu.folding import folded
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.training import matching
from tests.learning.packed_toys import CONFIG
from tests.network.toy_regions import toy_batch

GPU = torch.device("cuda", 0)
OPTIONS = [
    {},
    {"use_siamese": False},
    {"network": replace(CONFIG.network, use_pift=False)},
    {"network": replace(CONFIG.network, canonical_frame=False)},
]


@pytest.fixture
def stand_ins(monkeypatch):
    """Tensors without numbers; the assignment, which needs numbers, is replaced by a fixed one."""

    def assigned(cost):
        return torch.zeros(cost.shape[:2], dtype=torch.long, device=cost.device)

    monkeypatch.setattr(matching, "assign", assigned)
    with FakeTensorMode(allow_non_fake_inputs=False) as mode:
        yield mode


def moved(tensor):
    return torch.empty(tensor.shape, dtype=tensor.dtype, device=GPU)


def on_gpu(config, change=lambda network: network):
    """A network as after `.to(GPU)`: only its parameters and buffers are on the GPU."""
    with _disable_current_modes():
        network = change(SymmetryGraspNet(config))
    for module in network.modules():
        for name, tensor in module._parameters.items():
            if tensor is not None:
                module._parameters[name] = torch.nn.Parameter(moved(tensor))
        for name, tensor in module._buffers.items():
            module._buffers[name] = moved(tensor)
    return network


def sample(mode, config):
    generators = [np.random.default_rng(number) for number in range(3)]
    with _disable_current_modes():
        made = augmented(toy_batch(3, config.network.num_points), config, generators)
    return Sample.of({name: mode.from_tensor(each) for name, each in made.tensors().items()})


@pytest.mark.parametrize(
    "change",
    [lambda network: network.train(), lambda network: folded(network.eval())],
    ids=["training", "inference"],
)
def test_predictions_of_the_network_are_on_the_device_of_its_points(stand_ins, change):
    network = on_gpu(CONFIG.network, change)
    with torch.set_grad_enabled(network.training):
        prediction = network(torch.empty(3, CONFIG.network.num_points, 3, device=GPU))
    assert {
        each.device for each in vars(prediction).values() if isinstance(each, torch.Tensor)
    } == {GPU}


@pytest.mark.parametrize("options", OPTIONS)
def test_the_loss_of_a_training_step_stays_on_the_gpu(stand_ins, options):
    config = replace(CONFIG, **options)
    network = on_gpu(config.network).train()
    terms = sample_loss(network, sample(stand_ins, config), config, GPU)
    assert {term.device for term in terms.values()} == {GPU}


def test_a_tensor_left_on_the_cpu_is_found(stand_ins, monkeypatch):
    monkeypatch.setattr(matching, "assign", lambda cost: torch.zeros(3, 3, dtype=torch.long))
    network = on_gpu(CONFIG.network)
    with pytest.raises(RuntimeError, match="device"):
        sample_loss(network, sample(stand_ins, CONFIG), CONFIG, GPU)


def step(config):
    """Loss terms and gradients of one training step, double precision, on the CPU."""
    torch.manual_seed(0)
    network = SymmetryGraspNet(config.network).double().train()
    generators = [np.random.default_rng(number) for number in range(3)]
    made = augmented(toy_batch(3, config.network.num_points), config, generators).tensors()
    exact = {
        name: each.double() if each.is_floating_point() else each for name, each in made.items()
    }
    terms = sample_loss(network, Sample.of(exact), config, torch.device("cpu"))
    terms["total"].backward()
    return terms, {name: weight.grad for name, weight in network.named_parameters()}


@pytest.mark.parametrize("options", OPTIONS)
def test_the_code_for_gpus_gives_the_same_loss_and_gradients(options, monkeypatch):
    config = replace(CONFIG, **options)
    terms, gradients = step(config)
    monkeypatch.setattr(devices, "on_cpu", lambda _: False)
    other_terms, other_gradients = step(config)
    torch.testing.assert_close(other_terms, terms)
    torch.testing.assert_close(other_gradients, gradients)
    assert any(gradient.any() for gradient in gradients.values())
