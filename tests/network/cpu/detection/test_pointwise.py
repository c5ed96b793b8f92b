"""1 x 1 convolutions as matrix products say the same, and are all that is replaced."""

import torch
from torch import nn

from pipelines.network.cpu.detection.pointwise import Pointwise, replace_pointwise


def test_products_say_what_convolutions_say_and_only_these_are_replaced():
    torch.manual_seed(0)
    network = nn.Sequential(
        nn.Conv2d(6, 8, 1),
        nn.Conv2d(8, 8, 3, padding=1),
        nn.Sequential(nn.Conv2d(8, 7, 1, bias=False), nn.Conv2d(7, 5, 1, stride=2)),
    ).requires_grad_(False)
    images = torch.rand(2, 6, 9, 10), torch.rand(2, 9, 10, 6).movedim(-1, 1), torch.rand(0, 6, 4, 4)
    expected = [network(image) for image in images]
    replace_pointwise(network)
    found = [type(module) for module in network.modules() if not isinstance(module, nn.Sequential)]
    assert found == [Pointwise, nn.Conv2d, Pointwise, nn.Conv2d]
    for image, said in zip(images, expected, strict=True):
        torch.testing.assert_close(network(image), said)


def test_maps_whose_channels_lie_together_stay_so():
    product = Pointwise(nn.Conv2d(6, 8, 1).requires_grad_(False))
    image = torch.rand(1, 6, 9, 10).to(memory_format=torch.channels_last)
    assert product(image).is_contiguous(memory_format=torch.channels_last)
