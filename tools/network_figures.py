"""Evaluate grasp networks on packed regions: `python tools/network_figures.py PACKED NETWORK ...`.

Prints for each network the validation figures of `train` on all regions of PACKED, and the distance
of a scaled copy's points to the region's, before and after PIFT's first deformation, as a share of
their spread: the effect of T on a scaling (D. 96).
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pipelines.configs import NetworkConfig, TrainConfig
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.errors import counted, errors_as_sentences
from pipelines.inference import models
from pipelines.learning.grasp_network.grasp_training import VALIDATION_BATCH, GraspTraining
from pipelines.learning.grasp_network.region_sources import RegionSet, TrainingRegions
from pipelines.learning.loop.loaders import load_regions
from pipelines.network.model import UNITS_PER_METER, SymmetryGraspNet
from pipelines.network.training.augmentation import scaled_copy
from pipelines.network.training.region_batch import RegionBatch
from pipelines.network.weights_files import fill, read_weights


def figures(path: Path, regions: RegionSet) -> dict[str, float]:
    """Return the figures of the network at `path` by name."""
    tensors, settings = read_weights(path, SymmetryGraspNet.__name__, NetworkConfig)
    network, config = SymmetryGraspNet(settings), TrainConfig(network=settings)
    fill(network, tensors, path)
    source = TrainingRegions(None, None, config)
    trainee = GraspTraining(network.eval(), source, regions, config, torch.device("cpu"))
    return trainee.validate() | copy_offsets(network, regions, config)


@torch.no_grad()
def copy_offsets(
    network: SymmetryGraspNet, regions: RegionSet, config: TrainConfig
) -> dict[str, float]:
    """Return the median of `offset` without and with T; an empty mapping without PIFT."""
    if not network.is_canonical:
        return {}
    offsets = []
    for start in range(0, len(regions.indices), VALIDATION_BATCH):
        indices = regions.indices[start : start + VALIDATION_BATCH]
        generators = [np.random.default_rng(int(index)) for index in indices]
        initial = load_regions(regions.reader, indices, config.network, generators)
        copies = scaled_copy(initial, config.augmentation, generators)
        deformed = deformed_points(network, initial), deformed_points(network, copies)
        offsets.append(torch.stack([offset(initial.points, copies.points), offset(*deformed)]))
    before, after = torch.cat(offsets, 1).median(1).values.tolist()
    return {"copy_offset": before, "copy_offset_deformed": after}


def deformed_points(network: SymmetryGraspNet, regions: RegionBatch) -> Tensor:
    """Return (B, N, 3) the points as input of the first level."""
    features = network.features(regions.points, regions.ground, camera=regions.camera)
    deformation = features.deformation
    if deformation is None:
        raise ValueError("the network deforms no points")
    return deformation.deform(regions.points * UNITS_PER_METER)


def offset(
    points: Tensor,  # (B, N, 3)
    others: Tensor,  # (B, N, 3)
) -> Tensor:
    """Return (B,) root mean square distances of pairs, as shares of the spread of `points`."""
    apart = (points - others).square().sum(-1).mean(1)
    return (apart / (points - points.mean(1, keepdim=True)).square().sum(-1).mean(1)).sqrt()


@errors_as_sentences()
def main() -> None:
    """Print a line for each network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("packed", type=Path)
    parser.add_argument("networks", type=Path, nargs="+")
    options = parser.parse_args()
    reader = PackedReader(options.packed)
    regions = RegionSet(reader, np.arange(len(reader)))
    with models.one_thread_each():
        for path in options.networks:
            found = ", ".join(f"{key} {value:.4g}" for key, value in figures(path, regions).items())
            sys.stdout.write(f"{path}: {counted(len(reader), 'region')}, {found}\n")


if __name__ == "__main__":
    main()
