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

from pipelines.contents import json_object, mapping_in, reading, typed
from pipelines.errors import FormatError
from pipelines.learning.speed.gradients import Losses, loss_seed
from pipelines.storage.checkpoints import by_kind, load_weights, save_weights
from pipelines.storage.provenance import Stamp

PLACE = ("seed", "epoch", "step", "micro_batch")


@dataclass(frozen=True)
class Fault:
    """Weights, a micro-batch as tensors, its place in the training, and the settings."""

    path: Path
    weights: dict[str, Tensor]
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
    metadata = {"place": json.dumps(dict(zip(PLACE, place, strict=True)))}
    save_weights(path, tensors, metadata, stamp)


def read_fault(path: Path, stage: str) -> Fault:
    """Read a fault that `save_fault` wrote in a training of `stage`.

    Raises:
        FormatError: the file holds no fault, a damaged one, or one of another stage.
    """
    expected = f"NAME.fault.safetensors of {stage} is expected"
    tensors, metadata = load_weights(path)
    if "place" not in metadata or "provenance" not in metadata:
        raise FormatError(path, "holds no faulty batch", expected)
    with reading(path, "the faulty batch", expected):
        stamp = json_object(path, metadata["provenance"], "the stamp")
        if stamp["stage"] != stage:
            raise FormatError(path, f"holds a batch of {stamp['stage']}", expected)
        where = typed(dict[str, int], json_object(path, metadata["place"], "the place"))
        seed, epoch, step, number = (where[name] for name in PLACE)
        kinds, settings = by_kind(tensors, ("weights", "batch")), mapping_in(stamp, "config")
        place = seed, epoch, step, number
        return Fault(path, kinds["weights"], kinds["batch"], place, settings)


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
