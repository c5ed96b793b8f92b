"""Weights of other projects in torch's file format, read without running any code."""

import argparse
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.contents import UNFIT, reason
from pipelines.errors import FormatError
from pipelines.storage.checkpoints import load_weights
from pipelines.storage.files import existing

if TYPE_CHECKING:
    from torch import Tensor

# Keys of the tensors in checkpoints of training scripts, next to optimizer, epoch and args.
PLACES = ("model", "state_dict", "model_state_dict", "model_state", "module")
PARALLEL = "module."  # prefix of each name from DistributedDataParallel


def read_torch_weights(path: Path) -> "dict[str, Tensor]":
    """Read the named tensors of a `.pth` or `.safetensors` file; of a checkpoint, its model's.

    Raises:
        FormatError: the file holds no tensors by name.
    """
    import torch  # noqa: PLC0415 - slow to load

    if path.suffix == ".safetensors":
        return load_weights(path)[0]
    expected = "a file of tensors by name, as torch.save writes a state_dict, is expected"
    try:
        # Checkpoints may contain a script's options: names and values, no code.
        with torch.serialization.safe_globals([argparse.Namespace]):
            content = torch.load(existing(path), map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, *UNFIT) as error:
        found = f"cannot be read as weights ({type(error).__name__}: {reason(error)})"
        raise FormatError(path, found, expected) from error
    places = (
        [content, *(content[name] for name in PLACES if name in content)]
        if isinstance(content, Mapping)
        else []
    )
    found_tensors = next((each for each in places if _is_tensors(each)), None)
    if found_tensors is None:
        held = ", ".join(map(str, content)) if isinstance(content, Mapping) else type(content)
        raise FormatError(path, f"holds {reason(ValueError(held))}", expected)
    return {name.removeprefix(PARALLEL): tensor for name, tensor in found_tensors.items()}


def _is_tensors(content: object) -> bool:
    import torch  # noqa: PLC0415 - slow to load

    return (
        isinstance(content, Mapping)
        and len(content) > 0
        and all(isinstance(name, str) for name in content)
        and all(isinstance(each, torch.Tensor) for each in content.values())
    )
