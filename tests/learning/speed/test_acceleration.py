"""Faster steps are nearly the same steps; what is kept stays float32."""

import copy

import numpy as np
import pytest
import torch
from functorch.compile import nop
from torch import nn
from torch._dynamo.backends.common import aot_autograd
from torch._inductor.exc import InductorError, TritonMissing

from pipelines.configs import DetectorConfig
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.learning.grasp_network.grasp_training import GraspTraining
from pipelines.learning.grasp_network.region_sources import RegionSet, TrainingRegions, packed_items
from pipelines.learning.speed.acceleration import Acceleration, _chains, _HalfConv, _HalfLinear
from pipelines.learning.speed.gradients import GradientWorkers
from pipelines.learning.speed.processes import Processes
from pipelines.learning.speed.shares import cut
from pipelines.network.detection.mask_rcnn import build_detector
from pipelines.network.model import SymmetryGraspNet
from tests.learning.packed_toys import CONFIG, write_packed


class Calm(GraspTraining):
    """Batch norm as at inference: that of a few toys makes a large difference of a small one.

    Weights changed by a thousandth then turn the gradient by 40 degrees in float32 as well.
    """

    def loss(self, module, micro_batch, generator):
        return super().loss(module.eval(), micro_batch, generator)


@pytest.fixture(scope="module")
def trainee(tmp_path_factory):
    reader = PackedReader(write_packed(tmp_path_factory.mktemp("packed"), 1))
    regions = RegionSet(reader, np.arange(len(reader)))
    torch.manual_seed(0)
    network = SymmetryGraspNet(CONFIG.network)
    source = TrainingRegions(regions, None, CONFIG)
    return Calm(network, source, regions, CONFIG, torch.device("cpu"))


@pytest.fixture(autouse=True)
def fresh_compiler():
    """What one test compiled is not another's."""
    torch._dynamo.reset()


def gradients(trainee, acceleration):
    pieces = cut(packed_items(np.arange(4)), 4, Processes())
    loaded = [(piece, piece.load(trainee, 0, 0, 0)) for piece in pieces]
    with GradientWorkers(trainee, 1, acceleration=acceleration) as workers:
        losses, found = workers.gradients(loaded, (0, 0, 0))
    return losses, torch.cat([each.flatten() for each in found])


@pytest.fixture(scope="module")
def exact(trainee):
    return gradients(trainee, Acceleration())


def test_bf16_steps_are_nearly_those_of_float32(trainee, exact):
    losses, found = gradients(trainee, Acceleration("bf16"))
    assert losses["total"] != exact[0]["total"]  # it did something
    assert losses["total"] == pytest.approx(exact[0]["total"], rel=0.05)
    assert float(torch.cosine_similarity(found, exact[1], dim=0)) > 0.97


def test_training_in_bf16_learns(trainee):
    learner = copy.deepcopy(trainee)
    optimizer = torch.optim.Adam(learner.module.parameters(), 0.003)
    losses = []
    for _ in range(12):
        found, parts = gradients(learner, Acceleration("bf16")), learner.module.parameters()
        sizes = [each.numel() for each in learner.module.parameters()]
        for parameter, part in zip(parts, found[1].split(sizes), strict=True):
            parameter.grad = part.view_as(parameter)
        optimizer.step()
        losses.append(found[0]["total"])
    assert losses[-1] < 0.7 * losses[0]


def test_what_is_trained_and_kept_stays_float32(trainee):
    gradients(trainee, Acceleration("bf16"))
    assert not any(isinstance(part, _HalfLinear) for part in trainee.module.modules())
    assert {each.dtype for each in trainee.module.parameters()} == {torch.float32}


def test_coordinates_are_never_in_bf16():
    network = Acceleration("bf16").apply(SymmetryGraspNet(CONFIG.network))
    half = [name for name, part in network.named_modules() if isinstance(part, _HalfLinear)]
    assert len(half) > 10
    assert not [name for name in half if "pift" in name or "position" in name]
    last = [name for name, _ in network.heads.named_modules() if name.endswith(".6")]
    assert len(last) == 3
    assert not {f"heads.{name}" for name in last} & set(half)


def test_the_detectors_convolutions_take_part():
    detector = Acceleration("bf16").apply(build_detector(DetectorConfig()))
    half = [part for part in detector.modules() if isinstance(part, _HalfConv)]
    assert len(half) > 10
    made = detector.backbone(torch.randn(1, 6, 64, 64))
    assert {each.dtype for each in made.values()} == {torch.float32}


def test_dilated_convolutions_reach_as_far_in_bf16():
    torch.manual_seed(0)
    exact = nn.Sequential(nn.Conv2d(16, 16, 3, padding=2, dilation=2))
    half = Acceleration("bf16").apply(copy.deepcopy(exact))
    image = torch.rand(1, 16, 9, 9)
    torch.testing.assert_close(half(image), exact(image), atol=0.02, rtol=0.02)


@pytest.mark.filterwarnings("ignore:The .grad attribute")  # torch's own, while it compiles
def test_every_chain_is_compiled_and_steps_are_those_of_float32(trainee, exact):
    compiled = []

    def counting(graph, inputs):
        compiled.append(graph)
        return graph

    losses, found = gradients(trainee, Acceleration(compiled=True, backend=counting))
    chains = [str(chain) for chain in _chains(trainee.module)]
    assert len(compiled) >= len(set(chains)) > 8  # the compiler's own limit
    assert losses == pytest.approx(exact[0], rel=1e-4)
    assert float(torch.cosine_similarity(found, exact[1], dim=0)) > 0.999


def test_a_compiler_that_fails_is_a_sentence(trainee):
    def refusing(graph, inputs):
        raise RuntimeError("no compiler")

    with pytest.raises(SymgraspError, match="leave out --compile"):
        gradients(trainee, Acceleration(compiled=True, backend=refusing))


def test_a_gpu_that_the_compiler_does_not_know_is_a_sentence(trainee):
    def refusing(graph, inputs):
        raise TritonMissing(None)

    with pytest.raises(SymgraspError, match=r"working triton installation.*leave out --compile"):
        gradients(trainee, Acceleration(compiled=True, backend=refusing))


@pytest.mark.filterwarnings("ignore:The .grad attribute")  # torch's own, while it compiles
def test_a_compiler_that_fails_on_the_way_back_is_a_sentence(trainee):
    def refusing(graph, inputs):
        raise InductorError(RuntimeError("no compiler"), None)

    backend = aot_autograd(fw_compiler=nop, bw_compiler=refusing)
    with pytest.raises(SymgraspError, match=r"no compiler.*leave out --compile"):
        gradients(trainee, Acceleration(compiled=True, backend=backend))


def test_a_plain_chain_is_found_once():
    chain = nn.Sequential(nn.Sequential(nn.Linear(16, 16), nn.ReLU()), nn.Linear(16, 4))
    model = nn.ModuleDict({"chain": chain})
    Acceleration(compiled=True, backend="eager").apply(model)
    assert chain._compiled_call_impl is not None
    assert chain[0]._compiled_call_impl is None


def test_an_unknown_precision_names_the_known_ones():
    with pytest.raises(UnknownNameError, match="bf16, float32"):
        Acceleration("fp8")
