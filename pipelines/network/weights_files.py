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
CAMERA_INPUTS = 3  # inputs of a point for the direction to the camera
MOST_NAMED = 3  # most tensors of a kind that an error names


def weights_metadata(model: str, config: Any) -> dict[str, str]:  # noqa: ANN401 - any dataclass
    """Return the metadata of a weights file: the name `model` of a network, and its `config`."""
    return {"model": model, "config": json.dumps(dataclasses.asdict(config), sort_keys=True)}


def read_weights(
    path: Path, model: str, config_type: type[Config]
) -> tuple[dict[str, Tensor], Config]:
    """Read tensors and settings of the network called `model`.

    Raises:
        FormatError: the file holds no weights of that network, or lacks some of its settings.
        UnknownNameError, SettingError: it has unknown settings, as a later version may write.
    """
    tensors, metadata = load_weights(path)
    found = metadata.get("model", "no known network")
    if found != model or "config" not in metadata:
        raise FormatError(path, f"holds {found}", f"weights of {model} are expected")
    return tensors, weights_config(path, metadata["config"], config_type)


def weights_config(path: Path, config: str, config_type: type[Config]) -> Config:
    """Return the settings of a network from `config`, the metadata of the weights of `path`.

    Raises:
        FormatError: some settings are missing.
        UnknownNameError, SettingError: it has unknown settings, as a later version may write.
    """
    unnamed = NOT_NAMED_BEFORE.get(config_type.__name__, {})
    settings = {**unnamed, **json_object(path, config, "config")}
    needed = {field.name for field in dataclasses.fields(config_type)}  # type: ignore[arg-type]
    if needed - set(settings):
        missing = ", ".join(sorted(needed - set(settings)))
        expected = "an earlier version made it; train it again with this one"
        raise FormatError(path, f"lacks the settings {missing}", expected)
    return from_settings(config_type, settings, f"{path}: ")


def fill(module: nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """Give `module` the weights read from `path`, in single precision as these are.

    Raises:
        FormatError: the names or shapes of the tensors do not fit.
    """
    try:
        module.float().load_state_dict(tensors)  # a caller may have set another default of torch
    except RuntimeError as error:
        expected = "train it again with this version, or give weights made by it"
        found = tensor_differences(tensors, module.state_dict())
        raise FormatError(
            path, f"its tensors do not fit the network ({found})", expected
        ) from error


def widened(tensors: Mapping[str, Tensor], module: nn.Module) -> dict[str, Tensor]:
    """Return the weights of a network without the camera's direction, for `module` with it.

    The output stays the same: the additional inputs are the last of a layer and get weights of
    zero. Tensors that differ otherwise stay as they are.
    """
    wide = module.state_dict()
    result = dict(tensors)
    for name in tensors.keys() & wide.keys():
        added = functional.pad(tensors[name], (0, CAMERA_INPUTS)) if tensors[name].ndim else None
        if added is not None and added.shape == wide[name].shape:
            result[name] = added
    return result


def tensor_differences(found: Mapping[str, Tensor], wanted: Mapping[str, Tensor]) -> str:
    """Return the differences of `found` to `wanted` in words, with some tensors of each kind."""
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
