"""Layers that tell the same of a cloud in any company, and what torch's would tell."""

import pytest
import torch
from torch import nn

from pipelines.network.cloudwise import CloudLinear, RowLinear


def drawn(*shape):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("bias", [False, True])
@pytest.mark.parametrize("rows", [(1,), (8,), (500,), (4, 16)])
@pytest.mark.parametrize(("wide", "out"), [(4, 32), (192, 256)])  # few numbers a row, and many
@torch.no_grad()
def test_a_cloud_gets_the_same_bits_alone_and_in_company(rows, wide, out, bias):
    layer, clouds = CloudLinear(wide, out, bias=bias), drawn(7, *rows, wide)
    found = layer(clouds)
    torch.testing.assert_close(found, nn.functional.linear(clouds, layer.weight, layer.bias))
    for index in range(7):
        assert torch.equal(found[index], layer(clouds[index : index + 1])[0])


@torch.no_grad()
def test_every_third_point_of_clouds_is_no_other_layer():
    layer, clouds = CloudLinear(6, 5), drawn(3, 9, 6)
    assert torch.equal(layer(clouds[:, ::3]), layer(clouds[:, ::3].contiguous()))
    assert layer(clouds[:0]).shape == (0, 9, 5)


def test_training_takes_torchs_own_product():
    layer, clouds = CloudLinear(6, 5), drawn(3, 8, 6)
    found = layer(clouds)
    assert torch.equal(found, nn.functional.linear(clouds, layer.weight, layer.bias))
    assert found.grad_fn is not None


@pytest.mark.parametrize("out", [1, 9])
def test_a_row_gets_the_same_bits_wherever_it_stands(out):
    layer, rows = RowLinear(16, out), drawn(1500, 16)
    found = layer(rows)
    torch.testing.assert_close(found, nn.functional.linear(rows, layer.weight, layer.bias))
    for place in (0, 749, 1499):
        assert torch.equal(found[place], layer(rows[place : place + 1])[0])
        assert torch.equal(found[place], layer(rows[place:])[0])
