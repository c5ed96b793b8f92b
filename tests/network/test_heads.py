"""Directions as leading eigenvectors, and predictions at a part of the points."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.network.heads import Heads, leading_direction

seeds = st.integers(0, 2**31 - 1)


def six_of(matrix):
    return matrix[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_a_clear_leading_eigenvector_is_found_up_to_its_sign(seed):
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    matrix = torch.from_numpy(basis @ np.diag([1.0, 0.1, -0.3]) @ basis.T)
    cosine = float(leading_direction(six_of(matrix)) @ torch.from_numpy(basis[:, 0]))
    assert abs(cosine) > 1.0 - 1e-5


def test_its_gradient_equals_finite_differences():
    torch.manual_seed(0)
    six = torch.randn(5, 6, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(leading_direction, (six,))


def test_a_direction_that_turns_half_around_comes_back_without_a_jump():
    angles = torch.linspace(0.0, torch.pi, 200, dtype=torch.float64)
    axis = torch.stack([angles.cos(), angles.sin(), torch.zeros_like(angles)], -1)
    found = leading_direction(six_of(axis[:, :, None] * axis[:, None]))
    planes = found[:, :, None] * found[:, None]
    assert float((planes[1:] - planes[:-1]).abs().max()) < 0.04
    torch.testing.assert_close(planes[0], planes[-1])


def test_a_stride_predicts_the_same_symmetries_at_fewer_points():
    heads, features = Heads(16), torch.randn(2, 20, 16)
    affordance, *full = heads(features)
    same, *some = heads(features, stride=3)
    torch.testing.assert_close(same, affordance)
    for few, every in zip(some, full, strict=True):
        assert few.shape[1] == 7
        torch.testing.assert_close(few, every[:, ::3])
