"""Multi-Grasp against its published figures."""

import torch

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.peers.multi_grasp import ORIENTATIONS, build_multi_grasp
from pipelines.network.peers.rgd import rgd_pixels, rgd_tensor


def parameters(network) -> int:
    return sum(each.numel() for each in network.parameters())


def test_the_full_network_has_as_many_parameters_as_published():
    # Without the parameters of ResNet-50, which torchvision counts with a layer of 1000 classes.
    assert parameters(build_multi_grasp(PeerNetworkConfig("full"))) == 28_459_738


def test_the_light_network_has_an_eighth_of_the_parameters():
    assert parameters(build_multi_grasp(PeerNetworkConfig("light"))) < 3_700_000


def test_boxes_are_found_for_each_orientation():
    network = build_multi_grasp(PeerNetworkConfig("light")).eval()
    network.roi_heads.score_thresh = 0.0
    with torch.no_grad():
        (found,) = network([torch.zeros(3, 96, 128)])
    assert found["boxes"].shape[1] == 4
    assert set(found["labels"].tolist()) <= set(range(1, ORIENTATIONS))


def test_depth_takes_the_place_of_blue():
    color = torch.full((2, 2, 3), 100, dtype=torch.uint8).numpy()
    depth = torch.tensor([[0.0, 0.2], [0.81, 5.0]]).numpy()
    pixels = rgd_pixels(color, depth)
    assert pixels[..., 2].tolist() == [[0, 0], [130, 255]]
    assert pixels[..., :2].tolist() == color[..., :2].tolist()
    assert rgd_tensor(pixels).shape == (3, 2, 2)
