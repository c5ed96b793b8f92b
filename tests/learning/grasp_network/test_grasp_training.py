"""The grasp network's training, by the interface that the training loop uses."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines import train
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.geometry.symmetry import SPHERE_SLOT
from pipelines.learning.grasp_network.grasp_training import GraspTraining
from pipelines.learning.grasp_network.region_sources import RegionSet, TrainingRegions, packed_items
from pipelines.learning.loop.faults import save_fault
from pipelines.learning.speed.gradients import GradientWorkers
from pipelines.learning.speed.micro_batches import micro_batches_of
from pipelines.learning.speed.processes import Processes
from pipelines.network.model import SymmetryGraspNet
from pipelines.storage.provenance import make_stamp
from tests.learning.packed_toys import CONFIG, write_packed


@pytest.fixture(scope="module")
def regions(tmp_path_factory):
    reader = PackedReader(write_packed(tmp_path_factory.mktemp("packed"), 1))
    return RegionSet(reader, np.arange(len(reader)))


def training(regions, config=CONFIG):
    torch.manual_seed(0)
    network = SymmetryGraspNet(config.network)
    source = TrainingRegions(regions, None, config)
    return GraspTraining(network, source, regions, config, torch.device("cpu"))


def generators(count):
    return [np.random.default_rng((0, number)) for number in range(count)]


def test_micro_batches_divide_the_batch(regions):
    pieces = micro_batches_of(np.arange(5), training(regions).micro_batch_size, Processes())
    assert [len(piece.items) for piece in pieces] == [3, 2]
    assert [piece.first for piece in pieces] == [0, 3]
    assert sum(piece.share for piece in pieces) == pytest.approx(1.0)


def test_a_region_is_loaded_independently_of_the_rest_of_its_batch(regions):
    trainee = training(regions)
    together = trainee.load(packed_items(np.arange(4)), generators(4)).tensors()
    alone = trainee.load(packed_items(np.array([2])), generators(4)[2:3]).tensors()
    for name, tensor in alone.items():
        torch.testing.assert_close(tensor[0], together[name][2])


def test_big_and_accumulated_batches_have_the_same_gradient(regions):
    """Except for parts of one micro-batch: norm statistics, balance of Eq. 6, L^f's variance."""
    config = replace(CONFIG, weight_affordance=0.0, weight_feature=0.0)
    results = {}
    for size in (2, 6):
        trainee = training(regions, replace(config, micro_batch_size=size))
        own_loss = trainee.loss
        trainee.loss = lambda module, batch, generator, own_loss=own_loss: own_loss(
            module.eval(), batch, generator
        )
        pieces = micro_batches_of(packed_items(np.arange(6)), size, Processes())
        loaded = [(piece, piece.load(trainee, 0, 0, 0)) for piece in pieces]
        with GradientWorkers(trainee, 1) as workers:
            results[size] = workers.gradients(loaded, (0, 0, 0))
    small, big = results[2][0], results[6][0]
    for name in ("total", "existence", "parameters"):
        assert small[name] == pytest.approx(big[name], rel=1e-4), name
    for small, big in zip(results[2][1], results[6][1], strict=True):
        torch.testing.assert_close(small, big, rtol=1e-3, atol=1e-5)


def test_a_saved_batch_gives_the_same_loss_again(regions, tmp_path):
    trainee = training(regions)
    batch = trainee.load(packed_items(np.arange(3)), generators(3))
    terms = trainee.loss(trainee.module.train(), batch, torch.Generator())
    stamp = make_stamp("train", CONFIG)
    save_fault(tmp_path / "x.safetensors", trainee.module, batch.tensors(), (0, 0, 0, 0), stamp)
    again = train.replay(tmp_path / "x.safetensors")
    assert again == pytest.approx({name: float(each.detach()) for name, each in terms.items()})


@pytest.mark.parametrize(("siamese", "pift"), [(True, True), (False, False)])
def test_a_few_steps_on_a_few_regions_lower_the_loss(regions, siamese, pift):
    network = replace(CONFIG.network, use_pift=pift)
    trainee = training(regions, replace(CONFIG, use_siamese=siamese, network=network))
    batch = trainee.load(packed_items(np.arange(3)), generators(3))
    optimizer = torch.optim.Adam(trainee.module.parameters(), 0.003)
    losses = []
    for _ in range(20):
        terms = trainee.loss(trainee.module, batch, torch.Generator().manual_seed(0))
        optimizer.zero_grad()
        terms["total"].backward()
        optimizer.step()
        losses.append(float(terms["total"].detach()))
    assert losses[-1] < 0.6 * losses[0]


def loss_terms(trainee, sample):
    terms = trainee.loss(trainee.module.eval(), sample, torch.Generator())
    return {name: float(each.detach()) for name, each in terms.items()}


def test_both_branches_learn_from_labels_and_features_agree_with_siamese_training_alone(regions):
    trainee = training(regions)
    sample = trainee.load(packed_items(np.arange(3)), generators(3))
    shared = loss_terms(trainee, sample)
    apart = loss_terms(training(regions, replace(CONFIG, use_siamese=False)), sample)
    assert shared["feature"] > 0.0
    assert apart["feature"] == 0.0
    for name in ("affordance", "existence", "parameters"):
        assert shared[name] == pytest.approx(apart[name])
    relabelled = replace(sample, copies=replace(sample.copies, center=sample.copies.center + 0.1))
    assert loss_terms(trainee, relabelled)["parameters"] != shared["parameters"]


def test_the_labels_of_a_scaled_sphere_are_not_used(regions):
    trainee = training(regions)
    sample = trainee.load(
        packed_items(np.arange(len(regions.indices))), generators(len(regions.indices))
    )
    ball = sample.regions.existence[:, SPHERE_SLOT] > 0
    assert 0 < int(ball.sum()) < len(ball)
    moved = sample.copies.center + 0.1 * ball[:, None, None]
    relabelled = replace(sample, copies=replace(sample.copies, center=moved))
    assert loss_terms(trainee, relabelled) == loss_terms(trainee, sample)
    moved = sample.regions.center + 0.1 * ball[:, None, None]
    relabelled = replace(sample, regions=replace(sample.regions, center=moved))
    assert loss_terms(trainee, relabelled) != loss_terms(trainee, sample)


def test_every_weight_gets_a_gradient(regions):
    trainee = training(regions)
    batch = trainee.load(packed_items(np.arange(3)), generators(3))
    for pift in trainee.module.pifts:  # at the identity, the layers before have no gradient yet
        torch.nn.init.normal_(pift.regress.weight, std=0.1)
    trainee.loss(trainee.module, batch, torch.Generator().manual_seed(0))["total"].backward()
    idle = [name for name, p in trainee.module.named_parameters() if p.grad is None]
    assert idle == []


@pytest.mark.parametrize("loss", ["balanced", "paper"])
def test_predicting_less_affordance_everywhere_does_not_lower_the_validation_loss(regions, loss):
    trainee = training(regions, replace(CONFIG, loss=loss, weight_affordance=0.0))
    last = trainee.module.eval().heads.affordance[-1]
    torch.nn.init.zeros_(last.weight)
    losses = []
    for affordance in (0.9, 0.1):
        torch.nn.init.constant_(last.bias, affordance)
        losses.append(trainee.validate()["loss"])
    assert losses[1] == pytest.approx(losses[0])


def test_validation_reports_figures_of_all_kinds(regions):
    trainee = training(regions)
    trainee.module.eval()
    figures = trainee.validate()
    names = {"loss", "affordance_auc", "plane_angle_deg", "axis_angle_deg", "sphere_offset_m"}
    assert names <= figures.keys()
    assert all(np.isfinite(value) for value in figures.values())


def test_diverged_weights_have_no_figures(regions):
    trainee = training(regions)
    with torch.no_grad():
        trainee.module.heads.symmetry[-1].bias.fill_(math.nan)
    trainee.module.eval()
    figures = trainee.validate()
    assert [*figures] == ["loss"]
    assert math.isnan(figures["loss"])
