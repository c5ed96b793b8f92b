"""GG-CNN and GG-CNN2 against their published figures."""

import pytest
import torch

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.peers.ggcnn import GGCNN, MAPS, SIDES_BY


@pytest.mark.parametrize(("variant", "parameters"), [("light", 62_420), ("full", 66_676)])
def test_the_networks_have_as_many_parameters_as_published(variant, parameters):
    network = GGCNN(PeerNetworkConfig(variant))
    assert sum(each.numel() for each in network.parameters()) == parameters


@pytest.mark.parametrize("variant", ["light", "full"])
@pytest.mark.parametrize("times", [(25, 25), (3, 4)])
def test_maps_are_as_large_as_the_image(variant, times):
    height, width = (SIDES_BY[variant] * each for each in times)
    maps = GGCNN(PeerNetworkConfig(variant))(torch.zeros(1, 1, height, width))
    assert maps.shape == (1, len(MAPS), height, width)
