"""The loss of Sec. III-E: its laws, and its gradient against finite differences."""

from dataclasses import fields, replace

import pytest
import torch

from pipelines.configs import TrainConfig
from pipelines.network import losses
from pipelines.network.model import Prediction
from pipelines.network.regions import RegionBatch
from tests.network.toy_regions import toy_batch

CONFIG = TrainConfig()


def random_prediction(size, count, seed=0):
    g = torch.Generator().manual_seed(seed)
    direction = torch.nn.functional.normalize(torch.randn(size, count, 5, 3, generator=g), dim=-1)
    return Prediction(
        torch.randn(size, count, 8, generator=g),
        torch.rand(size, count, generator=g),
        torch.randn(size, count, 5, generator=g),
        0.03 * torch.randn(size, count, 5, 3, generator=g),
        direction,
    )


def perfect_prediction(truth):
    shape = (len(truth), truth.points.shape[1], 5)
    return Prediction(
        torch.zeros(*shape[:2], 8),
        truth.affordance,
        (40.0 * truth.existence - 20.0)[:, None].expand(shape),
        truth.center[:, None].expand(*shape, 3),
        truth.direction[:, None].expand(*shape, 3),
    )


def test_a_perfect_prediction_costs_nothing():
    truth = toy_batch(6, 40)
    prediction = perfect_prediction(truth)
    terms = losses.total_loss(prediction, truth, prediction.features, CONFIG, truth.points[:, :16])
    assert float(terms.total) < 0.3  # the square root's floor, a tenth of a millimetre
    assert float(terms.parameters) < 0.01


def test_the_total_is_the_weighted_sum_of_section_iii_e():
    truth, prediction = toy_batch(3, 20), random_prediction(3, 20)
    other = torch.zeros_like(prediction.features)
    terms = losses.total_loss(prediction, truth, other, CONFIG, truth.points[:, :8])
    expected = terms.feature + terms.affordance + 5.0 * (terms.existence + 5.0 * terms.parameters)
    torch.testing.assert_close(terms.total, expected)


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_the_order_of_the_true_planes_does_not_matter(order):
    truth, prediction = toy_batch(6, 20), random_prediction(6, 20)
    picked = torch.tensor([*order, 3, 4])
    shuffled = replace(
        truth,
        existence=truth.existence[:, picked],
        center=truth.center[:, picked],
        direction=truth.direction[:, picked],
    )
    first, second = (
        losses.total_loss(prediction, each, None, CONFIG, truth.points[:, :8]).total
        for each in (truth, shuffled)
    )
    torch.testing.assert_close(first, second)


def test_gradients_are_those_of_finite_differences():
    truth = toy_batch(2, 3)
    truth = RegionBatch(*(getattr(truth, field.name).double() for field in fields(RegionBatch)))
    fixed = random_prediction(2, 3)
    inputs = tuple(
        getattr(fixed, field.name).double().requires_grad_() for field in fields(Prediction)
    )
    other = torch.zeros_like(inputs[0]).detach()
    weight = losses.symmetry_weights(fixed.affordance.double())

    def loss(features, affordance, existence, center, direction):
        prediction = Prediction(features, affordance, existence, center, direction)
        # Eq. 7's weights have no gradient: held still here, for differences would see them.
        detached = replace(prediction, affordance=fixed.affordance.double())
        terms = losses.total_loss(detached, truth, other, CONFIG, truth.points)
        return terms.total - terms.affordance + losses.affordance_loss(affordance, truth.affordance)

    assert torch.autograd.gradcheck(loss, inputs, eps=1e-7, atol=1e-4, fast_mode=True)
    assert weight.grad_fn is None


def test_predicting_no_affordance_does_not_lower_the_symmetry_loss():
    truth, prediction = toy_batch(3, 20), random_prediction(3, 20)
    prediction = replace(prediction, affordance=torch.zeros(3, 20, requires_grad=True))
    assert float(losses.symmetry_weights(prediction.affordance).sum()) == pytest.approx(3.0)
    matched = losses.parameter_loss(prediction, truth, truth.points[:, :8])
    assert not (losses.symmetry_weights(prediction.affordance) * matched).requires_grad


def test_points_with_affordance_weigh_more():
    weight = losses.symmetry_weights(torch.tensor([[0.9, 0.0]]))[0]
    torch.testing.assert_close(weight, torch.tensor([1.0 / 1.1, 0.1 / 1.1]))


def test_rare_graspable_points_are_not_outvoted():
    truth = torch.zeros(1, 100)
    truth[0, :20] = 0.8
    # Missing all of the few positives costs half of what missing every point does.
    missed = losses.affordance_loss(torch.zeros(1, 100), truth)
    assert float(missed) == pytest.approx(0.8 / 2)
    raised = losses.affordance_loss(torch.full((1, 100), 0.8), truth)
    assert float(raised) == pytest.approx(0.8 / 2)
