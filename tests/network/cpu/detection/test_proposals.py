"""Boxes proposed with less work are the boxes that torchvision proposes."""

import pytest
import torch
from torchvision.models.detection.image_list import ImageList

from pipelines.configs import DetectorConfig
from pipelines.network.cpu.detection.proposals import Proposals
from pipelines.network.detection.mask_rcnn import build_detector

SIZES = [(120, 150), (128, 160)]


def network(seed):
    torch.manual_seed(seed)
    rpn = build_detector(DetectorConfig()).eval().rpn
    for layer in (rpn.head.cls_logits, rpn.head.bbox_pred):
        torch.nn.init.normal_(layer.weight, std=0.2)
    return rpn


def pyramid(scale=1.0):
    shapes = [(2, 64, -(-128 // stride), -(-160 // stride)) for stride in (4, 8, 16, 32, 64)]
    maps = (scale * torch.randn(shape) for shape in shapes)
    return {str(n): each.to(memory_format=torch.channels_last) for n, each in enumerate(maps)}


@torch.inference_mode()
def both(rpn, maps):
    images = ImageList(torch.zeros(2, 6, 128, 160), SIZES)
    (found, losses), (expected, _) = Proposals(rpn)(images, maps), rpn(images, maps)
    assert losses == {}
    return found, expected


@pytest.mark.parametrize("seed", range(4))
def test_each_of_two_images_gets_the_boxes_torchvision_gives_it(seed):
    found, expected = both(network(seed), pyramid())
    for ours, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0.0, atol=1e-3)
        assert len(ours) > 20


def test_boxes_that_are_likely_alike_keep_torchvisions_order():
    found, expected = both(network(0), pyramid(0.0))
    for ours, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0.0, atol=1e-3)


def test_boxes_off_the_image_are_not_proposed():
    rpn = network(0)
    torch.nn.init.constant_(rpn.head.bbox_pred.bias, -100.0)
    found, expected = both(rpn, pyramid())
    assert [len(boxes) for boxes in found] == [len(boxes) for boxes in expected] == [0, 0]
