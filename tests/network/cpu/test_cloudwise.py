"""Layers whose output for a cloud is the same in any batch, and equal to torch's."""

import pytest
import torch
from torch import nn

from pipelines.network.cpu.cloudwise import CloudChain, CloudLinear, RowLinear, threads_of_one_core


def drawn(*shape):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("bias", [False, True])
@pytest.mark.parametrize("rows", [(1,), (8,), (500,), (4, 16)])
@pytest.mark.parametrize(("wide", "out"), [(4, 32), (192, 256)])  # few numbers in a row, and many
@torch.no_grad()
def test_a_cloud_gets_the_same_bits_alone_and_in_a_batch(rows, wide, out, bias):
    layer, clouds = CloudLinear(wide, out, bias=bias), drawn(7, *rows, wide)
    found = layer(clouds)
    torch.testing.assert_close(found, nn.functional.linear(clouds, layer.weight, layer.bias))
    for index in range(7):
        assert torch.equal(found[index], layer(clouds[index : index + 1])[0])


@torch.no_grad()
def test_a_strided_view_of_clouds_gives_the_same_bits_as_its_copy():
    layer, clouds = CloudLinear(6, 5), drawn(3, 9, 6)
    assert torch.equal(layer(clouds[:, ::3]), layer(clouds[:, ::3].contiguous()))
    assert layer(clouds[:0]).shape == (0, 9, 5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("rows", [(0,), (1,), (500,), (4, 16)])
@torch.no_grad()
def test_a_chain_gives_the_output_of_its_layers_one_by_one(rows, dtype):
    layers = [CloudLinear(6, 16), CloudLinear(16, 8, bias=False), CloudLinear(8, 5)]
    layers[0].rectifies = layers[1].rectifies = True
    chain, clouds = CloudChain(*layers).to(dtype), drawn(3, *rows, 6).to(dtype)
    found = chain(clouds)
    assert torch.equal(found, layers[2](layers[1](layers[0](clouds))))
    with torch.enable_grad():  # layer by layer, by torch
        expected = clouds
        for layer, last in zip(layers, (torch.relu, torch.relu, nn.Identity()), strict=True):
            expected = last(nn.functional.linear(expected, layer.weight, layer.bias))
        torch.testing.assert_close(chain(clouds), expected)
    torch.testing.assert_close(found, expected.detach())


def test_training_uses_torchs_matrix_product():
    layer, clouds = CloudLinear(6, 5), drawn(3, 8, 6)
    found = layer(clouds)
    assert torch.equal(found, nn.functional.linear(clouds, layer.weight, layer.bias))
    assert found.grad_fn is not None


@pytest.mark.parametrize("out", [1, 9])
def test_a_row_gets_the_same_bits_at_any_place(out):
    layer, rows = RowLinear(16, out), drawn(1500, 16)
    found = layer(rows)
    torch.testing.assert_close(found, nn.functional.linear(rows, layer.weight, layer.bias))
    for place in (0, 749, 1499):
        assert torch.equal(found[place], layer(rows[place : place + 1])[0])
        assert torch.equal(found[place], layer(rows[place:])[0])


def test_threads_of_one_core_ignore_the_number_of_threads_set_elsewhere():
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        threads = threads_of_one_core()
        assert threads.submit(int, 1).result() == 1
        torch.set_num_threads(3)
        counts = [threads.submit(torch.get_num_threads) for _ in range(8)]
        assert {count.result() for count in counts} == {1}
        torch.set_num_threads(2)
        assert threads_of_one_core() is threads
    finally:
        torch.set_num_threads(before)
