"""train: the symmetry-aware grasp network on packed regions (Sec. III-E, III-G).

Reads   PACKED/**/*.h5              region clouds with labels, camera frame
Writes  NAME.safetensors            the best weights so far by validation on unseen scenes
        NAME.checkpoint.safetensors everything that `--resume` needs
        NAME.curves.png             loss and figures along the steps
        NAME.logs/                  TensorBoard scalars
        NAME.fault.safetensors      the batch, if a loss was not finite
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from pipelines.batch import StageReport
from pipelines.configs import NetworkConfig, TrainConfig
from pipelines.formats.files import existing
from pipelines.formats.packed_regions import PackedReader
from pipelines.formats.provenance import digest, digest_folder, make_stamp
from pipelines.learning import grasp_training
from pipelines.learning.faults import read_fault
from pipelines.learning.grasp_training import GraspTraining, RegionSet
from pipelines.learning.loaders import split_by_scene
from pipelines.learning.loop import TrainingRun
from pipelines.learning.options import LoopOptions
from pipelines.learning.processes import joined
from pipelines.learning.runs import RunRequest, describe, find_progress
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import fill, read_weights, weights_metadata

STAGE = "train"


def run(
    packed: Path,
    validation: Path | None,
    output: Path,
    config: TrainConfig,
    request: RunRequest,
    *,
    init: Path | None = None,
) -> StageReport:
    """Train on the folder `packed` and validate on `validation`, or on scenes held out.

    `init`: weights of an earlier training to start from, instead of drawn ones.
    """
    with joined(request.device) as (processes, device):
        started, report = time.monotonic(), StageReport(STAGE)
        inputs = _inputs(packed, validation, init)
        stamp = make_stamp(STAGE, config, seed=request.seed, inputs=inputs)
        earlier = find_progress(output, stamp, request)
        if earlier is not None and earlier.finished:
            report.skipped.append(output.name)
            return report
        train_set, val_set = region_sets(packed, validation, config, request.seed)
        network = build(config, request.seed, init)
        trainee = GraspTraining(network, train_set, val_set, config, device, processes)
        metadata = weights_metadata(SymmetryGraspNet.__name__, config.network)
        options = LoopOptions.of(config, request)
        training = TrainingRun(trainee, options, output, stamp, metadata, processes)
        if earlier is not None:
            training.resume()
        progress = training.run()
    report.done.append(output.name)
    report.notes[output.name] = describe(progress)
    report.seconds = time.monotonic() - started
    return report


def build(config: TrainConfig, seed: int, init: Path | None) -> SymmetryGraspNet:
    """Return the network to start from: drawn, or with the weights of `init`."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)  # layers are initialised from torch's own generator
        network = SymmetryGraspNet(config.network)
    if init is not None:
        fill(network, read_weights(init, SymmetryGraspNet.__name__, NetworkConfig)[0], init)
    return network


def replay(fault: Path) -> dict[str, float]:
    """Return the loss terms of the batch in `NAME.fault.safetensors`, computed again."""
    return grasp_training.replay(read_fault(fault))


def region_sets(
    packed: Path, validation: Path | None, config: TrainConfig, seed: int
) -> tuple[RegionSet, RegionSet]:
    """Return the regions to train on and those to validate on, of different scenes."""
    reader = PackedReader(packed)
    if validation is not None:
        held_out = PackedReader(validation)
        return RegionSet(reader, np.arange(len(reader))), RegionSet(
            held_out, np.arange(len(held_out))
        )
    train, val = split_by_scene(reader, config.val_fraction, np.random.default_rng(seed))
    return RegionSet(reader, train), RegionSet(reader, val)


def _inputs(packed: Path, validation: Path | None, init: Path | None) -> dict[str, str]:
    folders: Sequence[tuple[str, Path | None]] = (("packed", packed), ("validation", validation))
    inputs = {
        name: digest_folder(folder, "**/*.h5") for name, folder in folders if folder is not None
    }
    return inputs if init is None else inputs | {"init": digest(existing(init))}
