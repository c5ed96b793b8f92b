"""Layers of PointNet++ and the fast pooling of groups, against the textbook form."""

import pytest
import torch

from pipelines.network.cpu.cloudwise import CloudLinear
from pipelines.network.pointnet2 import FeaturePropagation, SetAbstraction, pooled_groups
from pipelines.network.sampling import (
    farthest_points,
    gather,
    interpolation_weights,
    nearest_neighbors,
)


def test_set_abstraction_equals_the_first_layer_applied_to_each_group():
    torch.manual_seed(0)
    layer = SetAbstraction(5, (8, 8, 6), 16, 4, stride=2).double().eval()
    all_points, all_features = torch.randn(2, 60, 3).double(), torch.randn(2, 60, 5).double()
    points, features = all_points, all_features
    centers = gather(points, farthest_points(points, 16))
    points, features = points[:, ::2], features[:, ::2]
    near = nearest_neighbors(centers, points, 4)
    offset = gather(points, near) - centers[:, :, None]
    hidden = torch.relu(layer.position(offset) + layer.content(gather(features, near)))
    expected = torch.relu(layer.point(layer.group(hidden).amax(2)))
    got_centers, got = layer(all_points, all_features)
    torch.testing.assert_close(got_centers, centers)
    torch.testing.assert_close(got, expected)


def test_feature_propagation_equals_interpolation_before_the_linear_layer():
    torch.manual_seed(0)
    layer = FeaturePropagation(5, 4, 6).double().eval()
    fine, coarse = torch.randn(2, 30, 3).double(), torch.randn(2, 9, 3).double()
    known, features = torch.randn(2, 30, 4).double(), torch.randn(2, 9, 5).double()
    index, weight = interpolation_weights(fine, coarse)
    interpolated = (gather(features, index) * weight[..., None]).sum(2)
    expected = torch.relu(layer.joined(layer.coarse(interpolated) + layer.fine(known)))
    torch.testing.assert_close(layer(fine, known, coarse, features), expected)


@pytest.mark.parametrize("centers", [40, 150])  # all groups at once, and in parts
def test_groups_pooled_cloud_by_cloud_equal_those_of_the_layers_to_the_last_bit(centers):
    torch.manual_seed(1)
    group = CloudLinear(32, 64, bias=False)
    projected, offset = torch.randn(3, 50, 32), torch.randn(3, centers, 32)
    neighbors = torch.randint(0, 50, (3, centers, 16))
    with torch.inference_mode():
        fast = pooled_groups.fast(projected, offset, neighbors, group)
        assert torch.equal(fast, pooled_groups.plain(projected, offset, neighbors, group))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("size", "centers", "members"), [(2, 9, 4), (3, 150, 16), (1, 1, 1)])
def test_gradients_of_pooled_groups_equal_those_of_the_layers(size, centers, members, threads):
    torch.manual_seed(0)
    group = SetAbstraction(5, (8, 6, 6), 9, 4).double().group
    neighbors = torch.stack([torch.randperm(150)[:members] for _ in range(size * centers)])
    neighbors = neighbors.view(size, centers, members)
    given = [torch.randn(size, count, 8).double().requires_grad_() for count in (150, centers)]
    inputs, before = [*given, group.weight], torch.get_num_threads()
    share = torch.randn(size, centers, 6).double()
    plain = pooled_groups.plain(*given, neighbors, group)
    expected = torch.autograd.grad((plain * share).sum(), inputs)
    torch.set_num_threads(threads)
    try:
        pooled = pooled_groups.fast(*given, neighbors, group)
        found = torch.autograd.grad((pooled * share).sum(), inputs)
        assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
    torch.testing.assert_close(found, expected)


def test_the_first_of_equal_members_gets_the_gradient():
    projected = torch.ones(1, 4, 2, requires_grad=True)
    neighbors = torch.tensor([[[2, 1, 3]]])
    group = torch.nn.Linear(2, 3, bias=False)
    torch.nn.init.ones_(group.weight)
    pooled = pooled_groups.fast(projected, torch.zeros(1, 1, 2), neighbors, group)
    pooled.sum().backward()
    assert projected.grad[0].tolist() == [[0, 0], [0, 0], [3, 3], [0, 0]]
