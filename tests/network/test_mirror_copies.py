"""Predictions of regions and of their mirror images, combined."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.configs import NetworkConfig
from pipelines.geometry.transforms import unit
from pipelines.network.mirror_copies import RegionOutputs, with_copy
from pipelines.network.model import Prediction, SymmetryGraspNet
from pipelines.network.predictor import GraspPredictor

CONFIG = NetworkConfig(
    input_frame="camera",
    num_points=200,
    set_points=(64, 32, 16, 4),
    set_neighbors=(8, 8, 8, 16),
)
MIRROR = np.array([-1.0, 1.0, 1.0])


def random_outputs(seed, regions=2, voting=30):
    rng = np.random.default_rng(seed)
    direction = unit(rng.normal(size=(regions, 1, 5, 3)) + np.zeros((voting, 1, 1)))
    return RegionOutputs(
        rng.uniform(size=(regions, 90)).astype(np.float32),
        rng.uniform(size=(regions, voting, 5)).astype(np.float32),
        rng.normal(size=(regions, voting, 5, 3)).astype(np.float32),
        direction.astype(np.float32),
    )


def reordered(one, order):
    columns = (one.existence, one.center, one.direction)
    return RegionOutputs(one.affordance, *(column[:, :, order] for column in columns))


def test_slots_of_a_mirror_image_are_sorted_by_the_planes_of_its_region():
    first = random_outputs(0)
    for order in ([1, 2, 0, 3, 4], [2, 1, 0, 3, 4], [0, 1, 2, 3, 4]):
        both = with_copy(first, reordered(first, order))
        for name in ("existence", "center", "direction"):
            value = getattr(both, name)
            assert_array_equal(value[:, :30], getattr(first, name))
            assert_array_equal(value[:, 30:], getattr(first, name))


def test_a_plane_predicted_with_the_opposite_normal_is_the_same_plane():
    first = random_outputs(1)
    turned = reordered(first, [1, 2, 0, 3, 4])
    both = with_copy(first, replace(turned, direction=-turned.direction))
    assert_array_equal(both.direction[:, 30:], -first.direction)


def test_affordances_are_averaged_and_axes_and_spheres_stay_in_their_slots():
    first, other = random_outputs(2), random_outputs(3)
    both = with_copy(first, other)
    assert_allclose(both.affordance, (first.affordance + other.affordance) / 2.0)
    assert_array_equal(both.existence[:, 30:, 3:], other.existence[:, :, 3:])
    assert_array_equal(both.center[:, :30], first.center)


class Echo(torch.nn.Module):
    """Predicts the position of each point as the centre of its symmetries."""

    def forward(self, points, ground, stride, camera):
        center = points[:, ::stride, None].repeat(1, 1, 5, 1)
        existence = torch.zeros(*center.shape[:3])
        return Prediction(points, 0.5 + 0.0 * points[..., 2], existence, center, center)


def test_predictions_of_the_mirror_image_are_mirrored_back():
    region = np.random.default_rng(0).normal((0.1, -0.2, 0.7), 0.03, (300, 3))
    echo = GraspPredictor(Echo(), CONFIG, torch.device("cpu"), mirrored=True)
    (prediction,) = echo.predict([region])
    voting = np.tile(region[prediction.index][::3], (2, 1))
    assert_allclose(prediction.center[:, 4], voting, atol=1e-6)


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return SymmetryGraspNet(CONFIG)


def test_a_region_and_its_mirror_image_get_mirrored_predictions(network):
    region = np.random.default_rng(1).normal((0.1, -0.2, 0.7), 0.03, (300, 3))
    asked = GraspPredictor(network, CONFIG, torch.device("cpu"), mirrored=True)
    alone = GraspPredictor(network, CONFIG, torch.device("cpu"))
    (one,), (other,) = asked.predict([region]), asked.predict([region * MIRROR])
    assert_allclose(one.affordance, other.affordance, atol=1e-6)
    half = len(one.existence) // 2
    # Axes and spheres have one slot each: the halves of the two predictions are swapped.
    for mine, theirs in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
        assert_allclose(one.existence[mine, 3:], other.existence[theirs, 3:], atol=1e-5)
        assert_allclose(one.center[mine, 3:], other.center[theirs, 3:] * MIRROR, atol=1e-5)
    (plain,), (twin,) = alone.predict([region]), alone.predict([region * MIRROR])
    assert (
        np.abs(plain.affordance - twin.affordance).max() > 1e-4
    )  # one prediction is not symmetric
    assert_array_equal(one.existence[:half], plain.existence)
