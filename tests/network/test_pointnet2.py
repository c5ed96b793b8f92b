"""The layers' rewritings change no result: against the textbook form, written out."""

import torch

from pipelines.network import grouping
from pipelines.network.pointnet2 import FeaturePropagation, SetAbstraction
from pipelines.network.pooling import max_over_group
from pipelines.network.sampling import farthest_points, gather, nearest_neighbors, three_nearest


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
    index, weight = three_nearest(fine, coarse)
    interpolated = (gather(features, index) * weight[..., None]).sum(2)
    expected = torch.relu(layer.joined(layer.coarse(interpolated) + layer.fine(known)))
    torch.testing.assert_close(layer(fine, known, coarse, features), expected)


def test_the_gradient_of_the_group_maximum_is_that_of_finite_differences():
    torch.manual_seed(0)
    values = torch.randn(2, 3, 4, 5, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(max_over_group, (values,))


def test_groups_pooled_cloud_by_cloud_are_those_of_the_layers_to_the_last_bit():
    torch.manual_seed(1)
    layer = SetAbstraction(5, (32, 64, 64), 40, 16, stride=3).eval()
    points, features = torch.randn(3, 150, 3), torch.randn(3, 150, 5)
    projected, offset = torch.randn(3, 50, 32), torch.randn(3, 40, 32)
    neighbors = torch.randint(0, 50, (3, 40, 16))
    with torch.inference_mode():
        assert grouping.applies_to(projected)
        fast = grouping.pooled_groups(projected, offset, neighbors, layer.group.weight)
        hidden = torch.relu(gather(projected, neighbors) + offset[:, :, None])
        assert torch.equal(fast, max_over_group(layer.group(hidden)))
        told = layer(points, features)[1]
    assert not grouping.applies_to(projected)  # with gradients, the layers themselves
    torch.testing.assert_close(told, layer(points, features)[1])
