"""Network weights and training checkpoints as safetensors: tensors and JSON, never pickle."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.contents import json_object, reading
from pipelines.errors import FormatError
from pipelines.storage.files import open_safetensors, write_bytes
from pipelines.storage.provenance import Stamp

if TYPE_CHECKING:
    from torch import Tensor

HEADER_LENGTH_BYTES = 8
ALIGNMENT = 8


@dataclass(frozen=True)
class TrainingState:
    """Everything that a training needs to resume as if it had never stopped."""

    model: dict[str, "Tensor"]
    optimizer: dict[str, Any]  # `state_dict()` of Adam, a state of tensors alone
    progress: dict[str, Any]  # JSON: epoch, step, losses


def save_weights(
    path: Path,
    tensors: Mapping[str, "Tensor"],
    metadata: Mapping[str, str],
    stamp: Stamp | None = None,
) -> None:
    """Write `tensors` with text `metadata`; the same content gives the same bytes.

    A `stamp` is stored as the metadata's `provenance`.
    """
    from safetensors.torch import save  # noqa: PLC0415 - imports torch

    texts = dict(metadata) | ({"provenance": stamp.as_text()} if stamp is not None else {})
    write_bytes(path, *_sorted_header(save(_apart(tensors), metadata=texts)))


def load_weights(path: Path, framework: str = "pt") -> tuple[dict[str, Any], dict[str, str]]:
    """Read tensors and metadata of a safetensors file; `framework` `np` gives arrays, not torch.

    Raises:
        FormatError: truncated, or not safetensors.
    """
    with open_safetensors(path, framework) as file:
        tensors = {name: file.get_tensor(name) for name in sorted(file.keys())}
        return tensors, dict(file.metadata() or {})


load_arrays = partial(load_weights, framework="np")


def save_training(path: Path, state: TrainingState, stamp: Stamp) -> None:
    """Write a training checkpoint: model and optimiser as tensors, the rest as JSON."""
    tensors = {f"model.{name}": tensor for name, tensor in state.model.items()}
    for parameter, values in state.optimizer["state"].items():
        tensors |= {f"optimizer.{parameter}.{name}": value for name, value in values.items()}
    rest = {"state": {}, "param_groups": state.optimizer["param_groups"]}
    metadata = {
        "optimizer": json.dumps(rest, sort_keys=True),
        "progress": json.dumps(state.progress, sort_keys=True),
    }
    save_weights(path, tensors, metadata, stamp)


def load_training(path: Path) -> TrainingState:
    """Read a checkpoint of `save_training`.

    Raises:
        FormatError: not a training checkpoint.
    """
    tensors, metadata = load_weights(path)
    if "optimizer" not in metadata or "progress" not in metadata:
        raise FormatError(path, "holds weights only", "a training checkpoint is expected")
    with reading(path, "the state of a training", "train again"):
        kinds = by_kind(tensors, ("model", "optimizer"))
        state = {int(number): each for number, each in by_kind(kinds["optimizer"]).items()}
        groups = json_object(path, metadata["optimizer"], "optimizer")["param_groups"]
        progress = json_object(path, metadata["progress"], "progress")
        return TrainingState(kinds["model"], {"state": state, "param_groups": groups}, progress)


def by_kind(
    tensors: Mapping[str, "Tensor"], known: Sequence[str] = ()
) -> dict[str, dict[str, "Tensor"]]:
    """Return tensors called KIND.NAME by kind and name.

    Raises:
        KeyError: a kind is not in `known`, unless `known` is empty.
    """
    kinds: dict[str, dict[str, Tensor]] = {kind: {} for kind in known} or defaultdict(dict)
    for name, tensor in tensors.items():
        kind, _, rest = name.partition(".")
        kinds[kind][rest] = tensor
    return kinds


def _apart(tensors: Mapping[str, "Tensor"]) -> dict[str, "Tensor"]:
    """Return `tensors` on the CPU, copied if they share memory, which the library refuses."""
    taken, plain = set(), {}
    for name, tensor in tensors.items():
        here = tensor.detach().cpu().contiguous()
        memory = here.untyped_storage().data_ptr()
        plain[name] = here.clone() if memory in taken else here
        taken.add(memory)
    return plain


def _sorted_header(data: bytes) -> tuple[bytes, memoryview]:
    """Return the header of a safetensors file, with sorted metadata, and the rest of the file.

    The library does not sort. The rest is the largest part by far and is not copied.
    """
    length = int.from_bytes(data[:HEADER_LENGTH_BYTES], "little")
    start = HEADER_LENGTH_BYTES + length
    header = json.loads(data[HEADER_LENGTH_BYTES:start])
    header["__metadata__"] = dict(sorted(header.get("__metadata__", {}).items()))
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return len(text).to_bytes(HEADER_LENGTH_BYTES, "little") + text, memoryview(data)[start:]
