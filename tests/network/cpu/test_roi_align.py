"""RoIAlign on channels-last maps gives torchvision's results."""

import copy

import pytest
import torch
from torchvision.ops import MultiScaleRoIAlign

from pipelines.network.cpu.roi_align import ChannelsLastRoIAlign

SIZES = [(90, 120), (96, 100)]
STRIDES = {"0": 4, "1": 8, "2": 16, "pool": 32}


def pyramid(generator):
    maps = {
        name: torch.randn(2, 5, 96 // stride, 128 // stride, generator=generator)
        for name, stride in STRIDES.items()
    }
    return {name: each.to(memory_format=torch.channels_last) for name, each in maps.items()}


def both(boxes, output_size, maps):
    theirs = MultiScaleRoIAlign(["0", "1", "2"], output_size, sampling_ratio=2)
    ours = copy.deepcopy(theirs)
    ours.__class__ = ChannelsLastRoIAlign
    with torch.inference_mode():
        return ours(maps, boxes, SIZES), theirs(maps, boxes, SIZES)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("output_size", [7, (3, 4)])
def test_boxes_of_two_images_have_the_features_of_torchvision(seed, output_size):
    generator = torch.Generator().manual_seed(seed)
    corners = torch.randn(2, 30, 2, generator=generator) * 40 + 50
    sides = torch.rand(2, 30, 2, generator=generator) ** 3 * 200
    boxes = list(torch.cat([corners, corners + sides], -1))  # many reach beyond the image
    found, expected = both(boxes, output_size, pyramid(generator))
    torch.testing.assert_close(found, expected)
    assert (found == 0).any()
    assert (found != 0).any()


def test_boxes_without_extent_or_beyond_the_image_have_features_too():
    boxes = [
        torch.tensor([[5.0, 5.0, 5.0, 5.0], [0.0, 0.0, 120.0, 90.0]]),
        torch.tensor([[-90.0, -80.0, -50.0, -40.0], [400.0, 10.0, 500.0, 20.0]]),
    ]
    found, expected = both(boxes, 7, pyramid(torch.Generator().manual_seed(0)))
    torch.testing.assert_close(found, expected)
    assert (found[2:] == 0).all()


def test_no_boxes_have_no_features_and_an_image_may_have_none():
    maps = pyramid(torch.Generator().manual_seed(0))
    none, one = torch.zeros(0, 4), torch.tensor([[1.0, 2.0, 30.0, 40.0]])
    assert both([none, none], 7, maps)[0].shape == (0, 5, 7, 7)
    torch.testing.assert_close(*both([none, one], 7, maps))


def test_maps_in_the_usual_layout_give_the_same_features():
    maps = pyramid(torch.Generator().manual_seed(0))
    boxes = [torch.tensor([[1.0, 2.0, 30.0, 40.0]]), torch.tensor([[9.0, 2.0, 90.0, 80.0]])]
    usual = {name: each.contiguous() for name, each in maps.items()}
    torch.testing.assert_close(both(boxes, 7, usual)[0], both(boxes, 7, maps)[0])
