"""The fast network gives the output of the plain one (Sec. III-E) on any device and threads."""

from dataclasses import replace

import pytest
import torch

from pipelines.configs import NetworkConfig
from pipelines.inference.models import NETWORK_WEIGHTS
from pipelines.network import devices
from pipelines.network.cpu.folding import folded
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import read_weights
from tests.network.plain_network import PlainNetwork

SMALL = NetworkConfig(num_points=160, set_points=(64, 24, 8, 4), set_neighbors=(8, 8, 8, 8))
TINY = NetworkConfig(set_points=(10, 6, 4, 2), set_neighbors=(4, 3, 3, 4), set_strides=(2, 1, 1, 1))
NAMES = ("features", "affordance", "existence", "center", "direction")


def clouds(size, count, seed=0):
    """Halves of ellipsoids that face a camera, centred."""
    g = torch.Generator().manual_seed(seed)
    points = torch.nn.functional.normalize(
        torch.randn(size, count, 3, generator=g).double(), dim=-1
    )
    points[..., 2] = points[..., 2].abs()
    points = points * torch.tensor([0.03, 0.04, 0.06])
    return points - points.mean(1, keepdim=True)


def learned(config, seed=0):
    """A network in double precision whose every weight and statistic is drawn at random."""
    torch.manual_seed(seed)
    network = SymmetryGraspNet(config).double().eval()
    for pift in network.pifts or ():
        torch.nn.init.normal_(pift.regress.weight, std=0.3)
        torch.nn.init.normal_(pift.power, std=0.1)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm1d):
            torch.nn.init.normal_(module.weight)
            torch.nn.init.normal_(module.bias)
            module.running_mean.normal_()
            module.running_var.uniform_(0.5, 2.0)
    return network


def default_network():
    tensors, config = read_weights(NETWORK_WEIGHTS, "SymmetryGraspNet", NetworkConfig)
    network = SymmetryGraspNet(config)
    network.load_state_dict(tensors)
    return network.double().eval(), config


@torch.no_grad()
def assert_alike(one, other, points, **tolerance):
    first, second = one(points), other(points)
    for name in NAMES:
        found, expected = getattr(first, name), getattr(second, name)
        torch.testing.assert_close(found, expected, **tolerance)


@pytest.mark.parametrize("sees_camera", [False, True])
@pytest.mark.parametrize("canonical", [False, True])
def test_the_network_gives_the_output_of_the_equations(canonical, sees_camera):
    config = replace(SMALL, canonical_frame=canonical, sees_camera=sees_camera)
    network = learned(config)
    assert_alike(network, PlainNetwork(network.state_dict(), config), clouds(3, 160))


def test_the_default_weights_give_the_output_of_the_equations_with_folded_norms_too():
    network, config = default_network()
    assert_alike(folded(network), PlainNetwork(network.state_dict(), config), clouds(1, 1500))


def test_the_network_is_plain_pointnet2_before_training():
    torch.manual_seed(0)
    network = SymmetryGraspNet(SMALL).double().eval()
    plain = PlainNetwork(network.state_dict(), SMALL, use_pift=False)
    assert_alike(network, plain, clouds(2, 160))
    torch.nn.init.normal_(network.pifts[0].regress.weight)
    with torch.no_grad():
        features, others = network(clouds(2, 160)).features, plain(clouds(2, 160)).features
    assert not torch.allclose(features, others, atol=1e-2)


def test_each_level_keeps_points_of_the_cloud():
    network = learned(SMALL)
    points = clouds(2, 160) * 10.0
    level = (points, torch.cat([points, points.new_zeros(2, 160, 4)], -1))  # height, direction
    for i in range(4):
        level = network._abstract(i, *level, network._deformation(i, *level))
        assert torch.cdist(level[0], points).amin(-1).amax() < 1e-6


def test_predictions_for_some_points_equal_those_for_all():
    network, points = learned(SMALL), clouds(2, 160)
    query = torch.tensor([[5, 0, 159], [7, 8, 9]])
    with torch.no_grad():
        some, every = network(points, query=query), network(points)
    for name in NAMES:
        expected = torch.stack([getattr(every, name)[b, query[b]] for b in range(2)])
        torch.testing.assert_close(getattr(some, name), expected)


def test_gradients_of_the_whole_network_equal_finite_differences():
    network, points, step = learned(TINY).train(), clouds(2, 24), 1e-8
    g = torch.Generator().manual_seed(1)
    shares = [torch.randn(column.shape, generator=g).double() for column in _said(network, points)]

    def weighed():
        return sum((c * s).sum() for c, s in zip(_said(network, points), shares, strict=True))

    weighed().backward()
    # One random direction for the weights of each layer.
    for part in [module for group in network.children() for module in group.children()]:
        direction = [torch.randn(p.shape, generator=g).double() for p in part.parameters()]
        expected = sum(
            (p.grad * d).sum() for p, d in zip(part.parameters(), direction, strict=True)
        )
        ends = []
        for move in (step, -2.0 * step):
            with torch.no_grad():
                torch._foreach_add_(list(part.parameters()), direction, alpha=move)
                ends.append(weighed())
        with torch.no_grad():
            torch._foreach_add_(list(part.parameters()), direction, alpha=step)
        torch.testing.assert_close(
            (ends[0] - ends[1]) / (2.0 * step), expected, rtol=1e-5, atol=1e-5
        )


def _said(network, points):
    prediction = network(points)
    return [getattr(prediction, name) for name in NAMES[1:]]


@pytest.mark.parametrize("learn", [True, False])
def test_every_weight_has_a_gradient_that_is_a_number(learn):
    network = learned(TINY).train() if learn else SymmetryGraspNet(TINY).double().train()
    sum(column.square().sum() for column in _said(network, clouds(2, 24))).backward()
    for name, value in network.named_parameters():
        assert value.grad is not None, name
        assert torch.isfinite(value.grad).all(), name


@pytest.mark.parametrize("change", [lambda network: network, folded], ids=["learned", "folded"])
@pytest.mark.parametrize("config", [SMALL, NetworkConfig()])
def test_the_code_for_gpus_gives_the_same_predictions(config, change, monkeypatch):
    network, points = change(learned(config)), clouds(2, config.num_points)
    with torch.no_grad():
        compiled = network(points)
        monkeypatch.setattr(devices, "on_cpu", lambda _: False)
        plain = network(points)
    for name in NAMES:
        torch.testing.assert_close(getattr(plain, name), getattr(compiled, name))


def test_one_thread_and_two_give_the_same_predictions():
    network, points = default_network()[0].float(), clouds(2, 1500).float()
    threads, found = torch.get_num_threads(), []
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            with torch.no_grad():
                found.append(network(points))
    finally:
        torch.set_num_threads(threads)
    for name in NAMES:
        torch.testing.assert_close(
            getattr(found[0], name), getattr(found[1], name), rtol=1e-3, atol=1e-3
        )


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cpu_and_gpu_give_the_same_predictions():
    network, points = learned(NetworkConfig()), clouds(3, NetworkConfig().num_points)
    with torch.no_grad():
        here, there = network(points), network.cuda()(points.cuda())
    for name in NAMES:
        torch.testing.assert_close(getattr(there, name).cpu(), getattr(here, name))
