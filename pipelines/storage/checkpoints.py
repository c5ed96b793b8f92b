"""Network weights and training checkpoints as safetensors: tensors and JSON, never pickle."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from pipelines.contents import json_object, reading
from pipelines.errors import FormatError
from pipelines.storage.files import write_bytes
from pipelines.storage.provenance import Stamp
from pipelines.storage.safetensors_files import open_safetensors

if TYPE_CHECKING:
    from torch import Tensor

HEADER_LENGTH_BYTES = 8
ALIGNMENT = 8


@dataclass(frozen=True)
class TrainingState:
    """Everything a training needs to go on as if it had never stopped."""

    model: dict[str, "Tensor"]
    optimizer: dict[str, Any]  # `state_dict()` of a torch optimiser
    progress: dict[str, Any] = field(default_factory=dict)  # JSON: epoch, step, losses, numpy rng
    rng: dict[str, "Tensor"] = field(default_factory=dict)  # name to torch generator state


def save_weights(
    path: Path,
    tensors: Mapping[str, "Tensor"],
    metadata: Mapping[str, str],
    stamp: Stamp | None = None,
) -> None:
    """Write `tensors` with text `metadata`; the same ones give the same bytes.

    A `stamp` is stored as the metadata's `provenance`.
    """
    from safetensors.torch import save  # noqa: PLC0415 - imports torch

    plain = {name: tensor.detach().cpu().contiguous().clone() for name, tensor in tensors.items()}
    texts = dict(metadata) | ({"provenance": stamp.as_text()} if stamp is not None else {})
    write_bytes(path, _sorted_header(save(plain, metadata=texts)))


def load_weights(path: Path, device: str = "cpu") -> tuple[dict[str, "Tensor"], dict[str, str]]:
    """Read tensors and metadata of a safetensors file.

    Raises:
        FormatError: truncated, or not safetensors.
    """
    return _load(path, "pt", device)


def load_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Read a safetensors file's tensors as arrays, and its metadata; needs no torch.

    Raises:
        FormatError: truncated, or not safetensors.
    """
    return _load(path, "np", "cpu")


def _load(path: Path, framework: str, device: str) -> tuple[dict[str, Any], dict[str, str]]:
    with open_safetensors(path, framework, device) as file:
        tensors = {name: file.get_tensor(name) for name in sorted(file.keys())}
        return tensors, dict(file.metadata() or {})


def save_training(path: Path, state: TrainingState, stamp: Stamp | None = None) -> None:
    """Write a training checkpoint: model, optimiser, generators as tensors, the rest as JSON."""
    optimizer_tensors, optimizer_rest = _split_optimizer(state.optimizer)
    tensors = {f"model.{name}": tensor for name, tensor in state.model.items()}
    tensors |= {f"optimizer.{name}": tensor for name, tensor in optimizer_tensors.items()}
    tensors |= {f"rng.{name}": tensor for name, tensor in state.rng.items()}
    metadata = {
        "optimizer": json.dumps(optimizer_rest, sort_keys=True),
        "progress": json.dumps(state.progress, sort_keys=True),
    }
    save_weights(path, tensors, metadata, stamp)


def load_training(path: Path, device: str = "cpu") -> TrainingState:
    """Read a checkpoint of `save_training`; generator states stay on the CPU, as torch wants.

    Raises:
        FormatError: not a training checkpoint.
    """
    tensors, metadata = load_weights(path, device)
    if "optimizer" not in metadata or "progress" not in metadata:
        raise FormatError(path, "holds weights only", "a training checkpoint is expected")
    groups: dict[str, dict[str, Tensor]] = {"model": {}, "optimizer": {}, "rng": {}}
    with reading(path, "the state of a training", "train again"):
        for name, tensor in tensors.items():
            kind, rest = name.split(".", 1)
            groups[kind][rest] = tensor.cpu() if kind == "rng" else tensor
        optimizer = json_object(path, metadata["optimizer"], "optimizer")
        return TrainingState(
            model=groups["model"],
            optimizer=_join_optimizer(groups["optimizer"], optimizer),
            progress=json_object(path, metadata["progress"], "progress"),
            rng=groups["rng"],
        )


def _split_optimizer(state: Mapping[str, Any]) -> tuple[dict[str, "Tensor"], dict[str, Any]]:
    """Split an optimiser's state into tensors, named PARAMETER.NAME, and JSON."""
    from torch import Tensor  # noqa: PLC0415

    tensors: dict[str, Tensor] = {}
    rest: dict[str, dict[str, Any]] = {}
    for parameter, values in state["state"].items():
        for name, value in values.items():
            if isinstance(value, Tensor):
                tensors[f"{parameter}.{name}"] = value
            else:
                rest.setdefault(str(parameter), {})[name] = value
    return tensors, {"state": rest, "param_groups": state["param_groups"]}


def _join_optimizer(tensors: Mapping[str, "Tensor"], rest: Mapping[str, Any]) -> dict[str, Any]:
    state: dict[int, dict[str, Any]] = {int(p): dict(v) for p, v in rest["state"].items()}
    for name, tensor in tensors.items():
        parameter, key = name.split(".", 1)
        state.setdefault(int(parameter), {})[key] = tensor
    return {"state": state, "param_groups": rest["param_groups"]}


def _sorted_header(data: bytes) -> bytes:
    """Return a safetensors file with its metadata in order; the library's order is random."""
    length = int.from_bytes(data[:HEADER_LENGTH_BYTES], "little")
    start = HEADER_LENGTH_BYTES + length
    header = json.loads(data[HEADER_LENGTH_BYTES:start])
    header["__metadata__"] = dict(sorted(header.get("__metadata__", {}).items()))
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return len(text).to_bytes(HEADER_LENGTH_BYTES, "little") + text + data[start:]
