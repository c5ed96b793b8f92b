"""The dense symmetry error in torch against the one in numpy, and its gradient."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry import symmetry_error
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.network.training import dense_error

seeds = st.integers(0, 2**31 - 1)


def case(seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(2, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return rng.normal(size=(40, 3)), direction, rng.normal(size=(2, 3))


def tensors(points, direction, center):
    p, d, c = (torch.from_numpy(each)[None] for each in (points, direction, center))
    return p, d[:, :1], c[:, :1], d[:, 1], c[:, 1]


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_reflection_error_equals_that_of_numpy(seed):
    points, direction, center = case(seed)
    predicted, truth = (ReflectionSymmetry(direction[i], center[i]) for i in range(2))
    expected = symmetry_error.symmetry_error(points, predicted, truth)
    p, n, c, true_n, true_c = tensors(points, direction, center)
    error = dense_error.reflection_errors(p, n, c, true_n, true_c)
    got = error[0, 0] / dense_error.reflection_extent(p, true_n, true_c)[0]
    assert_allclose(float(got), expected, rtol=1e-5)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_rotation_error_equals_that_of_numpy_at_the_same_turns(seed):
    points, direction, center = case(seed)
    predicted, truth = (RotationSymmetry(direction[i], center[i]) for i in range(2))
    expected = np.mean(
        [
            np.linalg.norm(
                RotationSymmetry(
                    np.sign(predicted.axis @ truth.axis) * predicted.axis, predicted.point
                ).turn(points, turn)
                - truth.turn(points, turn),
                axis=1,
            ).mean()
            for turn in dense_error.TURNS
        ]
    )
    got = dense_error.rotation_errors(*tensors(points, direction, center))
    assert_allclose(float(got), expected, rtol=1e-5)


def test_gradients_equal_finite_differences():
    p, n, c, true_n, true_c = tensors(*case(3))
    n, c = n.clone().requires_grad_(), c.clone().requires_grad_()
    for error in (dense_error.reflection_errors, dense_error.rotation_errors):
        assert torch.autograd.gradcheck(lambda n, c, e=error: e(p, n, c, true_n, true_c), (n, c))


def test_signs_do_not_matter():
    p, n, c, true_n, true_c = tensors(*case(4))
    for error in (dense_error.reflection_errors, dense_error.rotation_errors):
        torch.testing.assert_close(
            error(p, n, c, true_n, true_c), error(p, -n, c, true_n, true_c), rtol=1e-6, atol=1e-9
        )
