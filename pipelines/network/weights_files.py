"""Weights files of networks, with the settings that each network was built from."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from torch import Tensor, nn
from torch.nn import functional

from pipelines.configs import from_settings
from pipelines.configs.renamed import NOT_NAMED_BEFORE
from pipelines.contents import json_object
from pipelines.errors import FormatError
from pipelines.storage.checkpoints import load_weights

Config = TypeVar("Config")
MOST_NAMED = 3  # tensors of a kind that a sentence names


def weights_metadata(model: str, config: Any) -> dict[str, str]:  # noqa: ANN401 - any dataclass
    """Return the metadata of a weights file: the name `model` of a network, and its `config`."""
    return {"model": model, "config": json.dumps(dataclasses.asdict(config), sort_keys=True)}


def read_weights(
    path: Path, model: str, config_type: type[Config]
) -> tuple[dict[str, Tensor], Config]:
    """Read tensors and settings of the network called `model`.

    Raises:
        FormatError: the file holds no weights of that network, or does not say all of its settings.
        UnknownNameError, SettingError: it says others, as weights of a later version may.
    """
    tensors, metadata = load_weights(path)
    found = metadata.get("model", "no network that is known")
    if found != model or "config" not in metadata:
        raise FormatError(path, f"holds {found}", f"weights of {model} are expected")
    settings = json_object(path, metadata["config"], "config")
    needed = {field.name for field in dataclasses.fields(config_type)}  # type: ignore[arg-type]
    needed -= NOT_NAMED_BEFORE.get(config_type.__name__, frozenset())
    if needed - set(settings):
        unsaid = ", ".join(sorted(needed - set(settings)))
        expected = "an earlier version made it; train it again with this one"
        raise FormatError(path, f"does not say the settings {unsaid}", expected)
    return tensors, from_settings(config_type, settings, f"{path}: ")


def fill(module: nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """Give `module` the weights read from `path`.

    Raises:
        FormatError: names or shapes do not fit.
    """
    try:
        module.load_state_dict(tensors)
    except RuntimeError as error:
        expected = "train it again with this version, or give weights made by it"
        found = tensor_differences(tensors, module.state_dict())
        raise FormatError(
            path, f"its tensors do not fit the network ({found})", expected
        ) from error


def widened(tensors: Mapping[str, Tensor], module: nn.Module) -> dict[str, Tensor]:
    """Return weights of a network that sees less, so that `module` does with them as it did.

    The inputs that `module` has beside come last of a layer's, with weights of zero.
    """
    shapes = {name: each.shape for name, each in module.state_dict().items()}
    return {
        name: functional.pad(each, (0, max(0, shapes[name][-1] - each.shape[-1])))
        if each.ndim and each.ndim == len(shapes.get(name, ()))
        else each
        for name, each in tensors.items()
    }


def tensor_differences(found: Mapping[str, Tensor], wanted: Mapping[str, Tensor]) -> str:
    """Return in words how tensors differ from those that are wanted, some of each kind by name."""
    shared = sorted(found.keys() & wanted.keys())
    kinds = {
        "lacks": sorted(wanted.keys() - found.keys()),
        "does not know": sorted(found.keys() - wanted.keys()),
        "of another shape": [
            f"{name} {tuple(found[name].shape)} for {tuple(wanted[name].shape)}"
            for name in shared
            if found[name].shape != wanted[name].shape
        ],
    }
    listed = (
        f"{kind}: {', '.join(names[:MOST_NAMED])}"
        + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
        for kind, names in kinds.items()
        if names
    )
    return "; ".join(listed)
