"""The network of the critics: the same in numpy, in torch and compiled; probabilities."""

import numpy as np
import pytest
import torch

from pipelines.grasping.critics.point_critic import FeatureNames, PointCritic

NAMES = {
    "shared features": FeatureNames(("a", "b", "c"), ("d", "e"), ("f", "g", "h", "i")),
    "none": FeatureNames(("a", "b", "c"), (), ("d",)),
}


@pytest.fixture(params=NAMES)
def critic(request):
    names, rng = NAMES[request.param], np.random.default_rng(0)
    shapes = names.weight_shapes()
    weights = {
        name: rng.normal(scale=shape[-1] ** -0.5, size=shape).astype(np.float32)
        for name, shape in shapes.items()
    }
    weights["spread"] = np.abs(weights["spread"]) + np.float32(0.1)
    weights["calibration"] = np.float32([-0.5, 2.0])
    return PointCritic(names, weights)


def inputs(critic, count=40, points=16):
    rng, names = np.random.default_rng(1), critic.features
    shapes = (
        (count, points, len(names.point)),
        (count, len(names.shared)),
        (count, len(names.candidate)),
    )
    return [rng.normal(size=shape).astype(np.float32) for shape in shapes]


def written_out(critic, points, shared, candidate):
    """The logit of one candidate, a point at a time."""

    def through(name, x):
        for index in range(3):
            x = np.maximum(x, 0) if index else x
            x = critic.weights[f"{name}.{index}.weight"] @ x
            x = x + critic.weights[f"{name}.{index}.bias"]
        return x

    hidden = np.stack([through("point", np.concatenate([point, shared])) for point in points])
    standard = (candidate - critic.weights["mean"]) / critic.weights["spread"]
    return through("last", np.concatenate([hidden.max(0), hidden.mean(0), standard, shared]))[0]


def test_logits_equal_those_of_the_layers_written_out(critic):
    given = inputs(critic, 5)
    expected = [written_out(critic, *each) for each in zip(*given, strict=True)]
    np.testing.assert_allclose(critic.logits(*given), expected, rtol=1e-4, atol=1e-5)


def test_torch_and_the_compiled_network_give_the_same_logits(critic):
    expected = critic.logits(*inputs(critic))
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(critic.fast_logits(*inputs(critic)), expected, rtol=1e-4, atol=1e-5)
    tensors = PointCritic(
        critic.features, {name: torch.from_numpy(each) for name, each in critic.weights.items()}
    )
    found = tensors.logits(*map(torch.from_numpy, inputs(critic)), torch)
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-4, atol=1e-5)


def test_logits_do_not_depend_on_the_order_of_points(critic):
    points, *rest = inputs(critic)
    mixed = points[:, np.random.default_rng(1).permutation(points.shape[1])]
    here, there = (critic.fast_logits(each, *rest) for each in (points, mixed))
    np.testing.assert_allclose(here, there, rtol=1e-4, atol=1e-5)


def test_probabilities_are_calibrated_logits(critic):
    logits, found = critic.fast_logits(*inputs(critic)), critic.probability(*inputs(critic))
    np.testing.assert_allclose(found, 1 / (1 + np.exp(0.5 - 2.0 * logits)), rtol=1e-4)


def test_no_candidates_give_no_logits(critic):
    assert critic.probability(*inputs(critic, 0)).shape == (0,)
    assert critic.logits(*inputs(critic, 0)).shape == (0,)
