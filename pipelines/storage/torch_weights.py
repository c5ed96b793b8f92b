"""Weights in torch's own file format, which others publish; read without running any code."""

import pickle
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.errors import FormatError
from pipelines.storage.checkpoints import load_weights
from pipelines.storage.files import existing

if TYPE_CHECKING:
    from torch import Tensor


def read_torch_weights(path: Path) -> "dict[str, Tensor]":
    """Read the tensors of a `.pth` or `.safetensors` file by name.

    Raises:
        FormatError: the file holds anything but tensors by name.
    """
    import torch  # noqa: PLC0415 - slow to load

    if path.suffix == ".safetensors":
        return load_weights(path)[0]
    expected = "a file of tensors by name, as torch.save writes a state_dict, is expected"
    try:
        content = torch.load(existing(path), map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError) as error:
        raise FormatError(
            path, f"cannot be read as weights ({type(error).__name__})", expected
        ) from error
    if not isinstance(content, dict) or not all(
        isinstance(each, torch.Tensor) for each in content.values()
    ):
        raise FormatError(path, "holds something else than tensors by name", expected)
    return dict(content)
