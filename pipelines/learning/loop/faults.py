"""The micro-batch at which a training failed, kept with the weights at that step.

`NAME.fault.safetensors` holds `weights.*` and `batch.*`, and as metadata the place (seed, epoch,
step, number), the loss terms and the stamp with the settings. `replay` of the stage's module
computes the loss terms again.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pipelines.errors import FormatError
from pipelines.learning.speed.gradients import Losses, loss_seed
from pipelines.storage.checkpoints import by_kind, load_weights, save_weights
from pipelines.storage.provenance import Stamp


@dataclass(frozen=True)
class Fault:
    """Weights, a micro-batch as tensors, its place in the training, and the settings."""

    weights: Mapping[str, Tensor]
    batch: dict[str, Tensor]
    place: tuple[int, int, int, int]  # seed, epoch, step, number of the micro-batch
    settings: Mapping[str, Any]  # the stage's config

    def generator(self) -> torch.Generator:
        """Return the generator that the loss drew from."""
        return torch.Generator().manual_seed(loss_seed(*self.place))


def save_fault(
    path: Path,
    module: nn.Module,
    batch: Mapping[str, Tensor],
    place: tuple[int, int, int, int],
    stamp: Stamp,
) -> None:
    """Write a micro-batch whose loss or gradient is not finite."""
    tensors = {f"weights.{name}": tensor for name, tensor in module.state_dict().items()}
    tensors |= {f"batch.{name}": tensor for name, tensor in batch.items()}
    names = ("seed", "epoch", "step", "micro_batch")
    metadata = {"place": json.dumps(dict(zip(names, place, strict=True)))}
    save_weights(path, tensors, metadata, stamp)


def read_fault(path: Path) -> Fault:
    """Read a fault that `save_fault` wrote.

    Raises:
        FormatError: the file holds no fault.
    """
    tensors, metadata = load_weights(path)
    if "place" not in metadata or "provenance" not in metadata:
        raise FormatError(path, "holds no faulty batch", "NAME.fault.safetensors is expected")
    seed, epoch, step, number = json.loads(metadata["place"]).values()
    kinds = by_kind(tensors, ("weights", "batch"))
    settings = json.loads(metadata["provenance"])["config"]
    return Fault(kinds["weights"], kinds["batch"], (seed, epoch, step, number), settings)


def describe_losses(losses: Losses) -> str:
    """Return the loss terms in one line, non-finite terms first."""
    ordered = sorted(losses.items(), key=lambda item: math.isfinite(item[1]))
    return ", ".join(f"{name} {value:.4g}" for name, value in ordered)


def numbered(items: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Return the named tensors of items as one mapping, NUMBER.NAME."""
    return {
        f"{number}.{name}": tensor
        for number, item in enumerate(items)
        for name, tensor in item.items()
    }


def unnumbered(tensors: Mapping[str, Tensor]) -> list[dict[str, Tensor]]:
    """Return the items that `numbered` joined to one mapping."""
    items = by_kind(tensors)
    return [items[number] for number in sorted(items, key=int)]
