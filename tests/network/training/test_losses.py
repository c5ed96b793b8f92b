"""The loss of Sec. III-E: its laws, and its gradient against finite differences."""

from dataclasses import fields, replace

import pytest
import torch

from pipelines.configs import TrainConfig
from pipelines.geometry.symmetry import SPHERE_SLOT
from pipelines.network.model import Prediction
from pipelines.network.training import losses
from pipelines.network.training.region_batch import RegionBatch
from tests.network.toy_regions import toy_batch

CONFIG = TrainConfig()
LISTED = TrainConfig(existence="listed")


def parameter_loss(prediction, truth, points):
    """L_r of each point: the errors of the symmetries that exist."""
    return (losses.slot_errors(prediction, truth, points) * truth.existence[:, None]).sum(-1)


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
    terms = losses.total_loss(
        prediction, truth, (prediction.features,) * 2, CONFIG, truth.points[:, :16]
    )
    assert float(terms["total"]) < 0.3  # bound in the root: 0.1 mm
    assert float(terms["parameters"]) < 0.01


def test_the_total_is_the_weighted_sum_of_section_iii_e():
    truth, prediction = toy_batch(3, 20), random_prediction(3, 20)
    pair = prediction.features, torch.zeros_like(prediction.features)
    config = replace(CONFIG, weight_feature=3.0)
    terms = losses.total_loss(prediction, truth, pair, config, truth.points[:, :8])
    expected = (
        3.0 * terms["feature"]
        + terms["affordance"]
        + 5.0 * (terms["existence"] + 5.0 * terms["parameters"])
    )
    torch.testing.assert_close(terms["total"], expected)


def test_smaller_features_are_not_more_consistent():
    torch.manual_seed(0)
    first, second = torch.randn(2, 3, 20, 8)
    loss = losses.consistency_loss(first, second)
    torch.testing.assert_close(
        losses.consistency_loss(0.1 * first, 0.1 * second), loss, rtol=1e-3, atol=0.0
    )
    torch.testing.assert_close(loss, torch.tensor(2.0), rtol=0.1, atol=0.0)  # independent features
    assert float(losses.consistency_loss(first, first)) == 0.0
    assert float(losses.consistency_loss(torch.zeros(1, 2, 8), torch.zeros(1, 2, 8))) == 0.0


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
        losses.total_loss(prediction, each, None, CONFIG, truth.points[:, :8])["total"]
        for each in (truth, shuffled)
    )
    torch.testing.assert_close(first, second)


@pytest.mark.parametrize("row", [0, 2])
def test_regions_without_labels_do_not_change_the_loss(row):
    truth, prediction = toy_batch(3, 20), random_prediction(3, 20)
    labelled, points = torch.ones(3), truth.points[:, :8]
    labelled[row] = 0.0
    unlike = truth.affordance.clone()
    unlike[row] = torch.where(unlike[row] > 0.1, 0.9 * unlike[row], unlike[row])  # as graspable
    other = replace(truth, existence=truth.existence.clone(), affordance=unlike)
    other.existence[row] = 1.0 - other.existence[row]
    first, second = (
        losses.total_loss(prediction, each, None, LISTED, points, labelled)
        for each in (truth, other)
    )
    torch.testing.assert_close(first["existence"], second["existence"])
    torch.testing.assert_close(first["parameters"], second["parameters"])
    torch.testing.assert_close(first["affordance"], second["affordance"])
    every, changed = (
        losses.total_loss(prediction, each, None, LISTED, points) for each in (truth, other)
    )
    for name in ("existence", "parameters", "affordance"):
        assert every[name] != changed[name], name


def test_gradients_equal_finite_differences():
    truth = toy_batch(2, 3)
    truth = RegionBatch(*(getattr(truth, field.name).double() for field in fields(RegionBatch)))
    fixed = random_prediction(2, 3)
    inputs = tuple(
        getattr(fixed, field.name).double().requires_grad_() for field in fields(Prediction)
    )
    other = torch.zeros_like(inputs[0]).detach()

    def loss(features, affordance, existence, center, direction):
        prediction = Prediction(features, affordance, existence, center, direction)
        # Eq. 7's weights have no gradient: fixed here, as finite differences would include them.
        detached = replace(prediction, affordance=fixed.affordance.double())
        terms = losses.total_loss(detached, truth, (features, other), CONFIG, truth.points)
        return (
            terms["total"]
            - terms["affordance"]
            + losses.affordance_loss(affordance, truth.affordance)
        )

    assert torch.autograd.gradcheck(loss, inputs, eps=1e-7, atol=1e-4, fast_mode=True)


TERMS = {
    "feature": lambda p, t, o: losses.consistency_loss(p.features, o),
    "affordance": lambda p, t, o: losses.affordance_loss(p.affordance, t.affordance),
    "existence": lambda p, t, o: losses.existence_loss(p.existence, t).sum(),
    "parameters": lambda p, t, o: parameter_loss(p, t, t.points).sum(),
}


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("kind", [0, 1, 2])  # a box's planes, a can's axis, a ball
def test_the_gradient_of_each_term_equals_finite_differences(term, kind):
    truth = toy_batch(3, 3)[kind : kind + 1]
    truth = RegionBatch(*(getattr(truth, field.name).double() for field in fields(RegionBatch)))
    fixed = random_prediction(1, 3)
    names = [field.name for field in fields(Prediction)]
    inputs = tuple(getattr(fixed, name).double().requires_grad_() for name in names)
    other = torch.zeros(1, 3, 8).double()
    assert torch.autograd.gradcheck(
        lambda *values: TERMS[term](Prediction(*values), truth, other), inputs, eps=1e-7, atol=1e-4
    )


def test_eq_6_is_the_mean_absolute_difference_where_half_of_the_points_are_graspable():
    truth, predicted = torch.tensor([[0.0, 0.6, 0.0, 0.9]]), torch.tensor([[0.3, 0.5, -0.1, 1.2]])
    loss = losses.affordance_loss(predicted, truth)
    torch.testing.assert_close(loss, (predicted - truth).abs().mean())


def test_a_sphere_costs_the_squared_distance_of_its_centre_in_radii():
    points = torch.nn.functional.normalize(torch.randn(1, 60, 3), dim=-1) * 0.04
    existence = torch.tensor([[0.0, 0.0, 0.0, 0.0, 1.0]])
    nothing = torch.zeros(1, 5, 3)
    truth = RegionBatch(
        points, torch.zeros(1, 60), existence, nothing, nothing, torch.zeros(1), torch.zeros(1, 3)
    )
    prediction = random_prediction(1, 60)
    offset = prediction.center[:, :, 4]
    expected = offset.square().sum(-1) / 0.04**2
    torch.testing.assert_close(parameter_loss(prediction, truth, points), expected)


def test_eq_7_weights_each_point_by_its_affordance():
    truth, prediction = toy_batch(2, 20), random_prediction(2, 20)
    terms = losses.total_loss(prediction, truth, None, CONFIG, truth.points[:, :8])
    matched = losses.match_reflections(
        truth,
        truth.points[:, :8],
        prediction.direction[:, :, :3],
        prediction.center[:, :, :3],
        losses.symmetry_weights(prediction.affordance),
    )
    each = parameter_loss(prediction, matched, truth.points[:, :8])
    share = prediction.affordance + 0.1
    expected = ((each * share).sum(1) / share.sum(1)).mean()
    torch.testing.assert_close(terms["parameters"], expected)


def test_predicting_no_affordance_does_not_lower_the_symmetry_loss():
    truth, prediction = toy_batch(3, 20), random_prediction(3, 20)
    prediction = replace(prediction, affordance=torch.zeros(3, 20, requires_grad=True))
    assert float(losses.symmetry_weights(prediction.affordance).sum()) == pytest.approx(3.0)
    matched = parameter_loss(prediction, truth, truth.points[:, :8])
    assert not (losses.symmetry_weights(prediction.affordance) * matched).requires_grad


def test_points_with_affordance_have_more_weight():
    weight = losses.symmetry_weights(torch.tensor([[0.9, 0.0]]))[0]
    torch.testing.assert_close(weight, torch.tensor([1.0 / 1.1, 0.1 / 1.1]))


def test_rare_graspable_points_are_not_outvoted():
    truth = torch.zeros(1, 100)
    truth[0, :20] = 0.8
    # Missing all of the few positives costs half of the loss of missing every point.
    missed = losses.affordance_loss(torch.zeros(1, 100), truth)
    assert float(missed) == pytest.approx(0.8 / 2)
    raised = losses.affordance_loss(torch.full((1, 100), 0.8), truth)
    assert float(raised) == pytest.approx(0.8 / 2)


def test_the_papers_loss_is_plain_distances_weighted_by_the_predicted_affordance():
    truth, prediction = toy_batch(3, 20), random_prediction(3, 20)
    config = replace(CONFIG, loss="paper", weight_feature=1.0)
    copy, points = torch.zeros_like(prediction.features), truth.points[:, :8]
    terms = losses.total_loss(prediction, truth, (prediction.features, copy), config, points)
    distance = prediction.features.square().sum(-1).mean()
    torch.testing.assert_close(terms["feature"], distance)
    wrong = (prediction.affordance - truth.affordance).abs().mean()
    torch.testing.assert_close(terms["affordance"], wrong)  # Eq. 6
    twice = replace(prediction, affordance=0.5 * prediction.affordance)
    again = losses.total_loss(twice, truth, (prediction.features, copy), config, points)
    torch.testing.assert_close(again["existence"], 0.5 * terms["existence"])  # Eq. 7


def test_the_papers_loss_leaves_unlabelled_regions_out():
    truth, prediction = toy_batch(2, 20), random_prediction(2, 20)
    only = torch.tensor([1.0, 0.0])
    found = losses.plain_affordance_loss(prediction.affordance, truth.affordance, only)
    first = losses.plain_affordance_loss(
        prediction.affordance[:1], truth.affordance[:1], torch.ones(1)
    )
    torch.testing.assert_close(found, 0.5 * first)


@pytest.mark.parametrize(("share", "is_right"), [(0.13, True), (0.14, False), (0.36, False)])
def test_a_sphere_is_right_within_the_same_share_of_its_size_as_other_symmetries(share, is_right):
    points = 0.04 * torch.nn.functional.normalize(torch.randn(1, 60, 3), dim=-1)
    existence = torch.tensor([[0.0, 0.0, 0.0, 0.0, 1.0]])
    nothing = torch.zeros(1, 5, 3)
    truth = RegionBatch(
        points, torch.ones(1, 60), existence, nothing, nothing, torch.zeros(1), torch.zeros(1, 3)
    )
    found = perfect_prediction(truth)
    center = torch.zeros_like(found.center)
    center[..., SPHERE_SLOT, 0] = share * 0.04
    terms = losses.total_loss(replace(found, center=center), truth, None, CONFIG, points)
    assert (float(terms["existence"]) < 1.0) is is_right


def test_existence_may_need_a_right_prediction_in_addition_to_a_listed_symmetry():
    truth, right = toy_batch(1, 40), perfect_prediction(toy_batch(1, 40))  # a box
    wrong = replace(right, center=right.center + 0.05)

    def existence(prediction, config):
        terms = losses.total_loss(prediction, truth, None, config, truth.points[:, :16])
        return float(terms["existence"])

    assert existence(right, CONFIG) == pytest.approx(existence(right, LISTED), abs=1e-4)
    assert existence(wrong, LISTED) < 0.1
    assert existence(wrong, CONFIG) > 5.0
