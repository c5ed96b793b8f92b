"""Average the weights of networks that were trained further from the same weights.

`python -m tools.average_weights A B [C ...] --out OUT.safetensors`. The mean of such weights is
often as good as the mean of the networks' predictions, in one network's time (Wortsman et al.,
"Model soups", 2022).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from pipelines.configs import DetectorConfig, NetworkConfig
from pipelines.errors import SymgraspError, errors_as_sentences
from pipelines.network.weights_files import weights_config
from pipelines.storage.checkpoints import load_weights, save_weights

CONFIGS: dict[str, Any] = {"SymmetryGraspNet": NetworkConfig, "RegionDetector": DetectorConfig}
DESCRIPTION = ("model", "config", "features")  # metadata that networks of one kind share


def average_weights(paths: Sequence[Path], out: Path) -> None:
    """Write the mean of the weights of `paths`; numbers of steps are those of the first.

    Raises:
        SymgraspError: the files hold networks of different kinds, or no network.
    """
    read = [load_weights(path) for path in paths]
    kinds = [_kind(path, *each) for path, each in zip(paths, read, strict=True)]
    for path, kind in zip(paths, kinds, strict=True):
        if kind != kinds[0]:
            raise SymgraspError(f"{path} holds a network of another kind than {paths[0]}")
    first, metadata = read[0]
    mean = {name: _mean([tensors[name] for tensors, _ in read]) for name in first}
    described = {name: metadata[name] for name in DESCRIPTION if name in metadata}
    save_weights(out, mean, described)


def _kind(path: Path, tensors: dict[str, torch.Tensor], metadata: dict[str, str]) -> list[Any]:
    if "model" not in metadata:
        raise SymgraspError(f"{path} holds no network; give weights, such as NAME.safetensors")
    shapes = {name: each.shape for name, each in tensors.items()}
    config: Any = metadata.get("config")
    if config is not None and metadata["model"] in CONFIGS:
        config = weights_config(path, config, CONFIGS[metadata["model"]])
    return [shapes, metadata["model"], config, metadata.get("features")]


def _mean(tensors: Sequence[torch.Tensor]) -> torch.Tensor:
    if not tensors[0].is_floating_point():
        return tensors[0]
    return torch.stack([each.double() for each in tensors]).mean(0).to(tensors[0].dtype)


@errors_as_sentences()
def main() -> None:
    """Read the options and average."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path, nargs="+", help="files of networks of one kind")
    parser.add_argument("--out", type=Path, required=True, help="file of the mean")
    options = parser.parse_args()
    average_weights(options.weights, options.out)


if __name__ == "__main__":
    main()
