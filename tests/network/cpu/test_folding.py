"""Folded networks give the same output, and the trained networks do not change."""

import pytest
import torch

from pipelines.configs import DetectorConfig
from pipelines.network.cpu.folding import folded
from pipelines.network.detection.mask_rcnn import build_detector
from pipelines.network.pointnet2 import PointNorm
from tests.network.test_model import SMALL, assert_alike, clouds, learned


def test_a_folded_network_gives_the_same_output_and_the_trained_one_does_not_change():
    network = learned(SMALL)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    cheap = folded(network)
    assert_alike(cheap, network, clouds(2, 160))
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name]), name
    # Norms after a pooling stay: pooling takes the maximum of a product of any sign.
    norms = [module for module in cheap.modules() if isinstance(module, PointNorm)]
    assert len(norms) == len(cheap.set_abstractions)
    assert not any(value.requires_grad for value in cheap.parameters())


@pytest.mark.parametrize("variant", ["light", "resnet50"])
def test_a_folded_detector_gives_the_same_output_and_has_no_norm_left(variant):
    torch.manual_seed(0)
    model = build_detector(DetectorConfig(variant=variant)).eval()
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_(std=0.1)
            module.running_var.uniform_(0.5, 2.0)
            torch.nn.init.normal_(module.bias, std=0.1)
    cheap, image = folded(model), torch.randn(6, 64, 64)
    assert not [m for m in cheap.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    with torch.no_grad():
        maps, expected = cheap.backbone(image[None]), model.backbone(image[None])
    for name in expected:
        torch.testing.assert_close(maps[name], expected[name], rtol=1e-3, atol=1e-3)
