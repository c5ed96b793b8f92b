"""Stage `train`: training of the grasp network on packed regions (Sec. III-E, III-G).

Reads   PACKED/**/*.h5              region clouds with labels, camera frame
        ROOT/{models,symmetry,affordance}  with `--endless`: objects to render new regions of
Writes  NAME.safetensors            the best weights so far by validation on unseen scenes
        NAME.checkpoint.safetensors everything that `--resume` needs
        NAME.curves.png             loss and figures along the steps
        NAME.logs/                  TensorBoard scalars
        NAME.fault.safetensors      the batch, if a loss was not finite
"""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from pipelines.configs import NetworkConfig, TrainConfig
from pipelines.contents import mapping_in
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.errors import FormatError, ValueRangeError
from pipelines.learning.grasp_network import grasp_training
from pipelines.learning.grasp_network.grasp_training import GraspTraining
from pipelines.learning.grasp_network.region_sources import RegionSet, TrainingRegions
from pipelines.learning.loop.faults import read_fault
from pipelines.learning.loop.loaders import split_by_scene
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import RunRequest, find_progress, refuse_own_start
from pipelines.learning.speed.processes import process_group
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import fill, read_weights, weights_metadata, widened
from pipelines.runtime.batch import StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import existing
from pipelines.storage.provenance import digest, digest_folder, make_stamp, read_stamp

if TYPE_CHECKING:
    from pipelines.synthesis.endless_pool import EndlessPool

STAGE = "train"


@one_run_at_a_time(STAGE, "output")
def run(
    packed: Path | None,
    validation: Path | None,
    output: Path,
    config: TrainConfig,
    request: RunRequest,
    *,
    endless: Sequence[Path] = (),
    init: Path | None = None,
    workers: int = 1,
) -> StageReport:
    """Train on the folder `packed` and validate on `validation`, or on scenes held out.

    `endless`: datasets with labels; `config.endless.share` of each batch is rendered of their
    objects by `workers` processes. `init`: weights of an earlier training to start from.
    """
    with process_group(request.device) as (processes, device), ExitStack() as stack:
        started = time.monotonic()
        refuse_own_start(init, output)
        inputs = _inputs(packed, validation, endless, init)
        stamp = make_stamp(STAGE, config, seed=request.seed, inputs=inputs)
        earlier = find_progress(output, stamp, request)
        if earlier is not None and earlier.finished:
            return StageReport(STAGE, skipped=[output.name])
        train_set, val_set = region_sets(packed, validation, config, request.seed)
        rendered = None
        if endless:
            rendered = stack.enter_context(_renderers(endless, config, request.seed, workers))
        source = TrainingRegions(train_set, rendered, config)
        network = build(config, request.seed, init)
        trainee = GraspTraining(network, source, val_set, config, device, processes)
        metadata = weights_metadata(SymmetryGraspNet.__name__, config.network)
        training = TrainingRun(trainee, config, request, output, stamp, metadata, processes)
        return training.report(started, resumes=earlier is not None)


def _renderers(
    endless: Sequence[Path], config: TrainConfig, seed: int, workers: int
) -> "EndlessPool":
    """Return the rendering processes; faults of the inputs are raised before they start."""
    from pipelines.synthesis.endless import trainable_objects  # noqa: PLC0415 - slow to import
    from pipelines.synthesis.endless_pool import EndlessPool  # noqa: PLC0415
    from pipelines.synthesis.scenes.tables import check_object_counts  # noqa: PLC0415

    check_object_counts(config.endless.min_objects, config.endless.max_objects)
    for root in endless:
        trainable_objects(GraspNetRoot.finished(root))
    return EndlessPool(endless, config.endless, seed, workers)


def build(config: TrainConfig, seed: int, init: Path | None) -> SymmetryGraspNet:
    """Return the network to start from: with random weights, or with the weights of `init`.

    Raises:
        FormatError: `init` holds no such weights, or weights of a network with other settings;
            only `sees_camera` may differ, if it is off in `init` and on in `config`.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)  # layers are initialised from torch's own generator
        network = SymmetryGraspNet(config.network)
    if init is not None:
        tensors, settings = read_weights(init, SymmetryGraspNet.__name__, NetworkConfig)
        wanted = config.network
        if wanted.sees_camera and settings == replace(wanted, sees_camera=False):
            tensors = widened(tensors, network)
        elif settings != wanted:  # the shapes may agree, but not their meaning
            found = f"is of a network with {_different(settings, wanted)}"
            raise FormatError(init, found, f"{_different(wanted, settings)} is requested")
        fill(network, tensors, init)
    return network


def _different(one: NetworkConfig, other: NetworkConfig) -> str:
    """Return the settings of `one` that differ from those of `other`."""
    pairs = vars(one).items()
    return ", ".join(f"{name}={value}" for name, value in pairs if value != getattr(other, name))


def replay(fault: Path) -> dict[str, float]:
    """Return the loss terms of the batch in `NAME.fault.safetensors`, computed again."""
    return grasp_training.replay(read_fault(fault, STAGE))


def region_sets(
    packed: Path | None, validation: Path | None, config: TrainConfig, seed: int
) -> tuple[RegionSet | None, RegionSet]:
    """Return the packed regions for training and for validation, of different scenes.

    Raises:
        SymgraspError: there are no regions for validation, or none for training.
    """
    if validation is not None:
        val_set = _all_regions(validation)
        train_set = None if packed is None else _all_regions(packed)
        if train_set is not None:
            _refuse_shared(train_set.reader, val_set.reader)
        return train_set, val_set
    if packed is None:
        raise ValueRangeError(
            "--val",
            "not given",
            "a folder of packed regions to validate on, as no packed regions are trained on",
        )
    reader = PackedReader(packed)
    train, val = split_by_scene(reader, config.val_fraction, np.random.default_rng(seed))
    return RegionSet(reader, train), RegionSet(reader, val)


def _refuse_shared(train: PackedReader, validation: PackedReader) -> None:
    """Raise ValueRangeError if a scene to validate on is trained on, packed alike or otherwise."""
    trained = {_frames(path): path for path in train.paths}
    for path in validation.paths:
        if _frames(path) in trained:
            expected = f"a folder without trained scenes; {trained[_frames(path)]} is of its frames"
            raise ValueRangeError("--val", path, expected)


def _frames(path: Path) -> str:
    """Return the digest of the frames that `path` was packed of, or of the file without stamp."""
    inputs = mapping_in(read_stamp(path) or {}, "inputs")
    return str(inputs.get("frames") or digest(path))


def _all_regions(packed: Path) -> RegionSet:
    reader = PackedReader(packed)
    if not len(reader):
        raise ValueRangeError(f"number of regions in {packed}", 0, "at least 1; pack other scenes")
    return RegionSet(reader, np.arange(len(reader)))


def _inputs(
    packed: Path | None, validation: Path | None, endless: Sequence[Path], init: Path | None
) -> dict[str, str]:
    files: dict[str, tuple[Path | None, str]] = {
        "packed": (packed, "**/*.h5"),
        "validation": (validation, "**/*.h5"),
    }
    for number, root in enumerate(endless, 1):
        of_root = "endless" if number == 1 else f"endless {number}"
        files[f"{of_root} symmetry"] = (root, "symmetry/*.json")
        files[f"{of_root} affordance"] = (root, "affordance/*.h5")
    inputs = {name: digest_folder(root, glob) for name, (root, glob) in files.items() if root}
    return inputs if init is None else inputs | {"init": digest(existing(init))}
