"""GraspNet's baseline against its published figures, and its groups against plain loops."""

import pytest
import torch

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.peers.graspnet import GraspNetBaseline
from pipelines.network.peers.point_groups import first_inside, interpolated, points_in_balls


def count(*modules):
    return sum(each.numel() for module in modules for each in module.parameters())


@pytest.mark.parametrize("variant", ["light", "full"])
def test_each_part_has_as_many_parameters_as_published(variant):
    network = GraspNetBaseline(PeerNetworkConfig(variant))
    assert count(network.levels, network.merges) == 641_856
    assert count(network.approach) == 236_028
    assert count(network.crop) == 42_048
    assert count(network.operation) == 54_564
    assert count(network.tolerance) == 51_468
    assert count(network) == 1_025_964


def test_seeds_are_points_of_the_input_and_operations_have_four_depths():
    torch.manual_seed(0)
    network = GraspNetBaseline(PeerNetworkConfig()).eval()
    points = 0.3 * torch.rand(1, 2000, 3)
    with torch.no_grad():
        seeds, features = network.seeds(points)
        rotation = torch.eye(3).expand(1, seeds.points.shape[1], 3, 3)
        output = network.operations(points, seeds.points, rotation)
    assert features.shape == (1, 512, 256)
    torch.testing.assert_close(points[0, seeds.index[0]], seeds.points[0])
    assert seeds.views.shape == (1, 512, 300)
    for each in (output.score, output.angle, output.width, output.tolerance):
        assert each.shape == (1, 512, 4, 12)


def test_a_group_holds_the_first_points_inside_and_repeats_the_first():
    inside = torch.tensor([[0, 1, 1, 0, 1], [0, 0, 0, 1, 0], [0, 0, 0, 0, 0]], dtype=torch.bool)
    index, found = first_inside(inside, 2)
    assert index.tolist() == [[1, 2], [3, 3], [0, 0]]
    assert found.tolist() == [True, True, False]


def test_balls_hold_points_within_the_radius_only():
    torch.manual_seed(1)
    points = torch.rand(2, 300, 3)
    index = points_in_balls(points[:, :10], points, 0.3, 8)
    for cloud in range(2):
        away = (points[cloud][index[cloud]] - points[cloud, :10, None]).norm(dim=-1)
        assert float(away.max()) < 0.3


def test_features_are_interpolated_by_inverse_distance():
    points = torch.tensor([[[0.0, 0, 0], [3, 0, 0], [50, 0, 0], [60, 0, 0]]])
    features = torch.tensor([[[0.0], [1], [1], [1]]])
    found = interpolated(torch.tensor([[[1.0, 0, 0]]]), points, features)
    weights = torch.tensor([1.0, 1 / 2, 1 / 49])
    torch.testing.assert_close(found[0, 0, 0], 1 - weights[0] / weights.sum())
