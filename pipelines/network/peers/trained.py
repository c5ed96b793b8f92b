"""Networks of compared methods with the weights that `symgrasp train-baseline` wrote."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import nn

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.devices import find_device
from pipelines.network.peers.ggcnn import GGCNN
from pipelines.network.peers.graspnet import GraspNetBaseline
from pipelines.network.peers.multi_grasp import build_multi_grasp
from pipelines.network.peers.pointnetgpd import PointNetGPD
from pipelines.network.peers.symmetrynet import SymmetryNet
from pipelines.network.weights_files import fill, read_weights

# For each method the network's name in weights files, and the function that makes the network.
PEER_NETWORKS: dict[str, tuple[str, Callable[[PeerNetworkConfig], nn.Module]]] = {
    "gg-cnn": ("GG-CNN", GGCNN),
    "multi-grasp": ("Multi-Grasp", build_multi_grasp),
    "pointnetgpd": ("PointNetGPD", PointNetGPD),
    "graspnet": ("GraspNet baseline", GraspNetBaseline),
    "symmetrynet": ("SymmetryNet", SymmetryNet),
}


def trained_network(
    name: str, path: Path, device: str
) -> tuple[Any, PeerNetworkConfig, torch.device]:
    """Return the network of the method called `name` for inference, its settings and device.

    Raises:
        FormatError: the file holds no weights of this network.
    """
    model, build = PEER_NETWORKS[name]
    tensors, config = read_weights(path, model, PeerNetworkConfig)
    network, found = build(config), find_device(device)
    fill(network, tensors, path)
    return network.to(found).eval(), config, found
