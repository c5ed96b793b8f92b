"""PointNetGPD against its published figures."""

import pytest
import torch

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.peers.pointnetgpd import CLASSES, PointNetGPD


@pytest.mark.parametrize("variant", ["light", "full"])
def test_the_network_has_as_many_parameters_as_published(variant):
    network = PointNetGPD(PeerNetworkConfig(variant))
    assert sum(each.numel() for each in network.parameters()) == 1_604_620


def test_log_probabilities_do_not_depend_on_the_order_of_the_points():
    torch.manual_seed(0)
    network = PointNetGPD(PeerNetworkConfig()).eval()
    points = torch.rand(4, network.num_points, 3)
    with torch.no_grad():
        found, shuffled = network(points), network(points[:, torch.randperm(points.shape[1])])
    assert found.shape == (4, CLASSES)
    torch.testing.assert_close(found.exp().sum(dim=1), torch.ones(4))
    torch.testing.assert_close(found, shuffled)
