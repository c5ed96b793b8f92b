"""Networks of compared methods with the weights that `symgrasp train-baseline` wrote."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
from torch import nn

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.weights_files import fill, read_weights

Network = TypeVar("Network", bound=nn.Module)


def trained_network(
    path: Path, model: str, build: Callable[[PeerNetworkConfig], Network], device: torch.device
) -> tuple[Network, PeerNetworkConfig]:
    """Return the network called `model`, as `build` makes it, for inference; and its settings.

    Raises:
        FormatError: the file holds no weights of this network.
    """
    tensors, config = read_weights(path, model, PeerNetworkConfig)
    network = build(config)
    fill(network, tensors, path)
    network.to(device).eval()
    return network, config
