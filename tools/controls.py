"""Weights and true regions for the controls of `make tables`.

`python tools/controls.py random-network OUT.safetensors`: the network before training.
`python tools/controls.py constant-affordance OUT.safetensors`: the default network with the same
affordance at all points. `python tools/controls.py true-regions OUT ROOT`: the true symmetric
regions of a dataset's frames, for `infer --masks OUT`.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from pipelines.configs import InferConfig, NetworkConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.training.region_frames import read_region_frame
from pipelines.errors import errors_as_sentences
from pipelines.inference.models import NETWORK_WEIGHTS
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import read_weights, weights_metadata
from pipelines.storage.checkpoints import save_weights
from pipelines.storage.images import write_image

SEED = 0
AFFORDANCE = 0.9  # at every point
LAST_LAYER = "heads.affordance.6"


def random_network(out: Path) -> None:
    """Write a network of the default settings with weights drawn at random."""
    torch.manual_seed(SEED)
    network = SymmetryGraspNet(NetworkConfig())
    metadata = weights_metadata(SymmetryGraspNet.__name__, NetworkConfig())
    save_weights(out, network.state_dict(), metadata)


def constant_affordance(out: Path) -> None:
    """Write the default network with an affordance head that returns `AFFORDANCE`."""
    tensors, config = read_weights(NETWORK_WEIGHTS, SymmetryGraspNet.__name__, NetworkConfig)
    weight, bias = (tensors[f"{LAST_LAYER}.{name}"] for name in ("weight", "bias"))
    changed = {
        f"{LAST_LAYER}.weight": torch.zeros_like(weight),
        f"{LAST_LAYER}.bias": torch.full_like(bias, AFFORDANCE),
    }
    save_weights(out, tensors | changed, weights_metadata(SymmetryGraspNet.__name__, config))


def true_regions(out: Path, dataset: Path) -> int:
    """Write NAME_label.png with the true regions of each frame; return the number of frames."""
    root, frames = GraspNetRoot.finished(dataset), 0
    for files in (files for scene in root.scenes() for files in scene.frames()):
        path, frames = out / f"{files.name}_label.png", frames + 1
        if path.exists():
            continue
        shown = read_region_frame(root, files, InferConfig().min_region_pixels)
        label = np.zeros(shown.frame.depth.shape, np.uint8)
        for number, region in enumerate(shown.regions, start=1):
            label[region.mask] = number
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image(path, label)
    return frames


@errors_as_sentences()
def main() -> None:
    """Read the options and write the requested control."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "control", choices=("random-network", "constant-affordance", "true-regions")
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("root", type=Path, nargs="?", help="dataset of the true regions")
    options = parser.parse_args()
    if options.control == "true-regions":
        if options.root is None:
            parser.error("true-regions needs the ROOT of a dataset")
        true_regions(options.out, options.root)
    elif options.control == "random-network":
        random_network(options.out)
    else:
        constant_affordance(options.out)


if __name__ == "__main__":
    main()
