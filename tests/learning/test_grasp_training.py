"""The grasp network's training as the engine sees it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines.formats.packed_regions import PackedReader
from pipelines.learning.grasp_training import GraspTraining, RegionSet
from pipelines.network.model import SymmetryGraspNet
from tests.learning.packed_toys import CONFIG, write_packed


@pytest.fixture(scope="module")
def regions(tmp_path_factory):
    reader = PackedReader(write_packed(tmp_path_factory.mktemp("packed"), 1))
    return RegionSet(reader, np.arange(len(reader)))


def training(regions, config=CONFIG):
    torch.manual_seed(0)
    network = SymmetryGraspNet(config.network)
    return GraspTraining(network, regions, regions, config, torch.device("cpu"))


def test_micro_batches_share_out_the_batch(regions):
    pieces = training(regions).load(np.arange(5), np.random.default_rng(0))
    assert [len(piece) for _, piece in pieces] == [3, 2]
    assert sum(share for share, _ in pieces) == pytest.approx(1.0)


@pytest.mark.parametrize(("siamese", "pift"), [(True, True), (False, False)])
def test_a_few_steps_on_a_few_regions_lower_the_loss(regions, siamese, pift):
    network = replace(CONFIG.network, use_pift=pift)
    trainee = training(regions, replace(CONFIG, use_siamese=siamese, network=network))
    ((_, batch),) = trainee.load(np.arange(3), np.random.default_rng(0))
    optimizer = torch.optim.Adam(trainee.module.parameters(), 0.003)
    losses = []
    for _ in range(20):
        terms = trainee.loss(trainee.module, batch, torch.Generator().manual_seed(0))
        optimizer.zero_grad()
        terms["total"].backward()
        optimizer.step()
        losses.append(float(terms["total"].detach()))
    assert losses[-1] < 0.6 * losses[0]


def test_every_weight_gets_a_gradient(regions):
    trainee = training(regions)
    ((_, batch),) = trainee.load(np.arange(3), np.random.default_rng(0))
    for pift in trainee.module.pifts:  # at the identity, what lies before has no gradient yet
        torch.nn.init.normal_(pift.regress.weight, std=0.1)
    trainee.loss(trainee.module, batch, torch.Generator().manual_seed(0))["total"].backward()
    idle = [name for name, p in trainee.module.named_parameters() if p.grad is None]
    assert idle == []


def test_validation_reports_all_kinds(regions):
    trainee = training(regions)
    trainee.module.eval()
    figures = trainee.validate()
    names = {"loss", "affordance_auc", "plane_angle_deg", "axis_angle_deg", "sphere_offset_m"}
    assert names <= figures.keys()
    assert all(np.isfinite(value) for value in figures.values())
