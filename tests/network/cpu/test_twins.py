"""Every fast function gives the result of its plain twin; private functions are optional."""

import ast
import logging
from pathlib import Path

import pytest
import torch
from torch import nn
from torch.nn import functional

import pipelines
from pipelines.network import devices, pointnet2, sampling
from pipelines.network.cpu import products, twins
from pipelines.network.cpu.cloudwise import CloudLinear
from pipelines.network.cpu.twins import Twins, works

ROOT = Path(pipelines.__file__).parent


def drawn(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


PLACES = drawn(2, 30, 40, seed=5).argsort(-1)[..., :3]  # of 40 points, none twice in a group
CASES = {
    "farthest points": (sampling._farthest_points, (drawn(2, 90, 3), 20)),
    "nearest neighbours": (
        sampling.nearest_neighbors,
        (drawn(2, 9, 3), drawn(2, 50, 3, seed=1), 7),
    ),
    "three nearest": (sampling.three_nearest, (drawn(2, 9, 3), drawn(2, 50, 3, seed=1))),
    "pooled groups": (
        pointnet2.pooled_groups,
        (drawn(2, 40, 8), drawn(2, 30, 8, seed=1), PLACES, nn.Linear(8, 6, bias=False)),
    ),
    "linear": (products.linear, (drawn(11, 5), drawn(4, 5, seed=1), drawn(4, seed=2), True)),
}


@pytest.mark.parametrize("name", CASES)
@torch.no_grad()
def test_the_fast_form_is_used_on_a_cpu_and_gives_the_result_of_the_plain_one(name, monkeypatch):
    both, given = CASES[name]
    assert both.applies(*given)
    torch.testing.assert_close(both(*given), both.plain(*given))
    monkeypatch.setattr(both, "plain", None)
    torch.testing.assert_close(both(*given), both.fast(*given))


def test_the_gradients_of_the_fast_form_equal_those_of_the_plain_one():
    both, given = CASES["pooled groups"]
    inputs = [
        each.clone().requires_grad_()
        if torch.is_tensor(each) and each.is_floating_point()
        else each
        for each in given
    ]
    wanted = inputs[:2]
    share = drawn(*both.plain(*inputs).shape, seed=9)
    expected, found = (
        torch.autograd.grad((form(*inputs) * share).sum(), wanted)
        for form in (both.plain, both.fast)
    )
    torch.testing.assert_close(found, expected)


def test_all_twins_of_the_network_are_compared_here():
    modules = (sampling, pointnet2, products)
    pairs = {
        each for module in modules for each in vars(module).values() if isinstance(each, Twins)
    }
    assert pairs == {both for both, _ in CASES.values()}


def test_the_plain_form_is_used_except_on_a_cpu(monkeypatch):
    monkeypatch.setattr(devices, "on_cpu", lambda _: False)
    for name in ("farthest points", "nearest neighbours", "pooled groups"):
        both, given = CASES[name]
        monkeypatch.setattr(both, "fast", None)
        both(*given)


@pytest.fixture
def nothing_is_known_yet():
    works.cache_clear()
    yield
    works.cache_clear()


class Gone:
    """A library without its private functions."""

    def __getattr__(self, name):
        raise AttributeError(f"no attribute {name}")


@pytest.mark.usefixtures("nothing_is_known_yet")
@pytest.mark.parametrize("how", ["gone", "other arguments", "other numbers"])
@torch.no_grad()
def test_torchs_public_linear_layer_replaces_a_missing_private_one(how, monkeypatch, caplog):
    rows, weight = drawn(9, 5), drawn(4, 5, seed=1)

    class Other:
        @staticmethod
        def _linear_pointwise(*given):
            if how == "other arguments":
                raise RuntimeError("expected at most 3 arguments")
            return functional.linear(*given[:3]) + 1.0

    monkeypatch.setattr(torch.ops, "mkldnn", Gone() if how == "gone" else Other())
    with caplog.at_level(logging.WARNING, twins.__name__):
        found = products.linear(rows, weight, None, True)
        products.linear(rows, weight)
    assert torch.equal(found, functional.linear(rows, weight).relu())
    (record,) = caplog.records  # one warning only
    assert "Linear layers by oneDNN do not work with this torch" in record.getMessage()


@pytest.mark.usefixtures("nothing_is_known_yet")
@torch.no_grad()
def test_a_cloud_gets_the_same_features_without_the_private_linear_layer(monkeypatch):
    layer, clouds = CloudLinear(5, 4), drawn(3, 20, 5)
    expected = layer(clouds)
    monkeypatch.setattr(torch.ops, "mkldnn", Gone())
    works.cache_clear()
    torch.testing.assert_close(layer(clouds), expected)


# Private names of torch and torchvision, by the module that uses them and can do without.
PRIVATE = {
    "network/cpu/products.py": {"torch.ops.mkldnn._linear_pointwise"},
    "network/cpu/torchvision_start.py": {"torch._dynamo.utils"},
}


def private_names(path: Path) -> set[str]:
    """Return a module's dotted names that begin with torch and have a part with an underscore."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.ImportFrom(module=str(module), names=names):
                found |= {f"{module}.{name.name}" for name in names}
            case ast.Attribute():
                found.add(ast.unparse(node))
            case ast.Constant(value=str(text)):
                found.add(text)
    return {
        name
        for name in found
        if name.partition(".")[0] in {"torch", "torchvision", "functional", "nn"}
        and " " not in name
        and any(part.startswith("_") and not part.startswith("__") for part in name.split("."))
    }


def test_private_names_of_torch_are_used_only_where_they_are_optional():
    found = {
        path.relative_to(ROOT).as_posix(): names
        for path in sorted(ROOT.rglob("*.py"))
        if (names := private_names(path))
    }
    assert found == PRIVATE
