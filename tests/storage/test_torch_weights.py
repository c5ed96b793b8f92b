"""Weights of other projects: a state_dict or a checkpoint with one, of which no code is run."""

import argparse
from pathlib import Path

import pytest
import torch
from torch import nn

from pipelines.errors import FormatError
from pipelines.network.weights_files import fill
from pipelines.storage.torch_weights import read_torch_weights

TENSORS = {"weight": torch.ones(2, 3), "bias": torch.zeros(2)}
OPTIONS = argparse.Namespace(lr=0.01, epochs=26)


class Code:
    """An object of code, which no file of weights may contain."""


@pytest.mark.parametrize(
    "content",
    [
        TENSORS,
        {"model": TENSORS, "optimizer": {"state": {}}, "epoch": 9},
        {"model": TENSORS, "args": OPTIONS},
        {"state_dict": {f"module.{name}": each for name, each in TENSORS.items()}, "epoch": 1},
    ],
)
def test_the_tensors_of_a_model_are_read_from_a_checkpoint(tmp_path: Path, content: object) -> None:
    torch.save(content, tmp_path / "x.pth")
    found = read_torch_weights(tmp_path / "x.pth")
    assert found.keys() == TENSORS.keys()
    assert all(torch.equal(found[name], TENSORS[name]) for name in TENSORS)


@pytest.mark.parametrize("content", [{"epoch": 9}, [1, 2], {}, {"model": 3}, {"model": {"a": 1}}])
def test_a_file_without_tensors_by_name_is_refused_with_its_content(
    tmp_path: Path, content: object
) -> None:
    torch.save(content, tmp_path / "x.pth")
    with pytest.raises(FormatError, match="holds"):
        read_torch_weights(tmp_path / "x.pth")


def test_code_is_refused_even_next_to_tensors(tmp_path: Path) -> None:
    torch.save({"model": TENSORS, "hook": Code()}, tmp_path / "x.pth")
    with pytest.raises(FormatError, match="UnpicklingError"):
        read_torch_weights(tmp_path / "x.pth")


def test_tensors_that_do_not_fit_are_named(tmp_path: Path) -> None:
    given = {"weight": torch.ones(2, 4), "other": torch.ones(1)}
    with pytest.raises(FormatError) as error:
        fill(nn.Linear(3, 2), given, tmp_path)
    words = ("lacks: bias", "does not know: other", "weight (2, 4) for (2, 3)")
    assert all(word in str(error.value) for word in words)
