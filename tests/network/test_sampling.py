"""Sampling and interpolation against plain loops."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.network import devices, sampling


def clouds(size, count, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(size, count, 3))).float()


def naive_farthest(cloud, count, first):
    chosen = [first]
    while len(chosen) < count:
        gap = np.linalg.norm(cloud[:, None] - cloud[chosen][None], axis=-1).min(1)
        chosen.append(int(gap.argmax()))
    return chosen


@pytest.fixture(params=[True, False], ids=["loops", "torch"])
def loops(request, monkeypatch):
    monkeypatch.setattr(devices, "on_cpu", lambda _: request.param)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("count", [60, 1500])
def test_farthest_points_follow_the_greedy_rule(count):
    points = clouds(2, count)
    found = sampling.farthest_points(points, 24).numpy()
    for cloud, chosen in zip(points.numpy(), found, strict=True):
        assert chosen.tolist() == naive_farthest(cloud, 24, 0)


def test_a_cloud_smaller_than_the_sample_is_taken_completely():
    assert_array_equal(sampling.farthest_points(clouds(2, 5), 9).numpy(), [[0, 1, 2, 3, 4]] * 2)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("count", [20, 200])
def test_neighbors_are_the_nearest(count):
    queries, support = clouds(2, 30, 1), clouds(2, count, 2)
    found = sampling.nearest_neighbors(queries, support, 7).numpy()
    distance = torch.cdist(queries, support).numpy()
    assert_array_equal(np.sort(found), np.sort(distance.argsort(-1)[..., :7]))


def test_no_more_neighbors_are_returned_than_there_are():
    assert sampling.nearest_neighbors(clouds(1, 4), clouds(1, 3), 16).shape == (1, 4, 3)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("count", [20, 200])
def test_interpolation_is_the_mean_by_inverse_squared_distance(count):
    queries, support = clouds(2, 30, 3), clouds(2, count, 4)
    values = torch.randn(2, count, 5, generator=torch.Generator().manual_seed(0))
    got = sampling.weighted_sum(values, *sampling.interpolation_weights(queries, support)).numpy()
    for b in range(2):
        for i in range(30):
            squared = ((queries[b, i] - support[b]) ** 2).sum(-1).numpy()
            near = squared.argsort()[:3]
            weight = 1.0 / (squared[near] + 1e-8)
            expected = (values[b, near].numpy() * weight[:, None]).sum(0) / weight.sum()
            assert_allclose(got[b, i], expected, rtol=2e-3, atol=1e-4)


def test_threads_change_nothing():
    points = clouds(6, 400)
    alone = sampling.nearest_neighbors(points, points, 5)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        assert torch.equal(sampling.nearest_neighbors(points, points, 5), alone)
    finally:
        torch.set_num_threads(before)


def test_gather_picks_points_of_each_cloud_by_its_own_indices():
    values = torch.arange(12.0).view(2, 3, 2)
    index = torch.tensor([[[2, 0]], [[1, 1]]])
    assert sampling.gather(values, index).tolist() == [[[[4, 5], [0, 1]]], [[[8, 9], [8, 9]]]]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("size", [1, 2])
def test_missing_points_have_no_weight(size, dtype):
    places, weights = sampling.interpolation_weights(
        clouds(1, 70).to(dtype), clouds(1, size, 1).to(dtype)
    )
    assert weights.dtype == dtype
    assert_array_equal(weights[0, :, size:], 0.0)
    assert_allclose(weights.sum(-1), 1.0, rtol=1e-6)
    assert ((places >= 0) & (places < size)).all()
