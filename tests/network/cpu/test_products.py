"""Linear layers by the faster library give torch's results, where there are no gradients."""

import pytest
import torch
from torch.nn import functional

from pipelines.network.cpu import products


def drawn(*shape, seed=0, dtype=torch.float32):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed)).to(dtype)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("has_onednn", [True, False])
@pytest.mark.parametrize("rectifies", [True, False])
@pytest.mark.parametrize("biased", [True, False])
@pytest.mark.parametrize("count", [0, 1, 300])
@torch.no_grad()
def test_a_layer_gives_the_result_of_torchs_layer(
    count, biased, rectifies, has_onednn, dtype, monkeypatch
):
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: has_onednn)
    rows, weight = drawn(count, 20, dtype=dtype), drawn(33, 20, seed=1, dtype=dtype)
    bias = drawn(33, seed=2, dtype=dtype) if biased else None
    expected = functional.linear(rows, weight, bias)
    expected = expected.relu() if rectifies else expected
    found = products.linear(rows, weight, bias, rectifies)
    assert found.dtype == dtype
    torch.testing.assert_close(found, expected)


def test_rows_that_are_not_contiguous_give_the_same_result():
    rows, weight = drawn(60, 40), drawn(7, 20, seed=1)
    with torch.no_grad():
        found = products.linear(rows[::3, ::2], weight)
        assert torch.equal(found, products.linear(rows[::3, ::2].contiguous(), weight))


def test_torchs_layer_is_used_where_there_are_gradients():
    rows, weight = drawn(5, 4), drawn(3, 4, seed=1).requires_grad_()
    found = products.linear(rows, weight, rectifies=True)
    found.sum().backward()
    expected = torch.relu(functional.linear(rows, weight.detach()))
    torch.testing.assert_close(found.detach(), expected)
    assert weight.grad is not None
    assert bool(weight.grad.any())
