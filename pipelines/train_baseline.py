"""Stage `train-baseline`: training of a method that the paper compares with.

Reads   ROOT/scenes/scene_NNNN/CAMERA/  depth, label, and the labels of the method, such as rect
Writes  NAME.safetensors             the best weights so far by validation on unseen scenes
        NAME.frames/*.h5             the frames as the method's inputs and targets, made once
        NAME.checkpoint.safetensors  everything that `--resume` needs
        NAME.curves.png              losses along the steps
        NAME.logs/                   TensorBoard scalars
        NAME.fault.safetensors       the batch, if a loss was not finite
"""

import time
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import torch

from pipelines.configs import TrainBaselineConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.held_back import refuse_held_back
from pipelines.dataset.scene_digests import inputs_of_scenes
from pipelines.dataset.training.region_frames import split_frames, strided_frames
from pipelines.errors import counted
from pipelines.learning.loop.faults import read_fault
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import RunRequest, find_progress
from pipelines.learning.peers.peer import (
    count_peer_frames,
    labels_of,
    refuse_lacking,
    write_peer_frames,
)
from pipelines.learning.peers.registry import trained_peer
from pipelines.learning.speed.processes import process_group
from pipelines.network.peers.trained import PEER_NETWORKS
from pipelines.network.weights_files import weights_metadata
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, drop_damaged, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import real_path
from pipelines.storage.provenance import digest_text, make_stamp

STAGE = "train-baseline"


@one_run_at_a_time(STAGE, "output")
def run(
    name: str,
    root: Path,
    output: Path,
    config: TrainBaselineConfig,
    request: RunRequest,
    *,
    split: str | None = "train",
    camera: str | None = None,
    options: BatchOptions | None = None,
) -> StageReport:
    """Prepare the frames of `split` (None: all) of `root` next to `output`, then train on them.

    `name`: name of the compared method.

    Raises:
        MissingInputError: the root lacks labels that the method needs.
    """
    method = trained_peer(name)
    config = config.with_schedule(method.peer.schedule)
    with process_group(request.device) as (processes, device):
        started = time.monotonic()
        items = peer_items(name, root, output, config, split, camera)
        inputs = {"root": real_path(root).name, "split": split or "all", "camera": camera or "all"}
        inputs["scenes"] = digest_text("\n".join(item.stamp.as_digest() for item in items))
        settings = {"method": name, **asdict(config)}
        stamp = make_stamp(STAGE, settings, seed=request.seed, inputs=inputs)
        earlier = find_progress(output, stamp, request)
        if earlier is not None and earlier.finished:
            return StageReport(STAGE, skipped=[output.name])
        with processes.one_first(options or BatchOptions()) as batch:
            step = partial(_prepare_scene, root=GraspNetRoot(root), peer=name, config=config)
            drop_damaged(items, batch)
            prepared = run_batch(STAGE, items, step, batch)
        if prepared.failed:
            return prepared
        targets = [item.target for item in items]
        frames = split_frames(targets, count_peer_frames, config.val_fraction, request.seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(request.seed)  # layers are initialised from torch's own generator
            trainee = method(frames, config, device, processes)
        metadata = weights_metadata(PEER_NETWORKS[name][0], config.network)
        training = TrainingRun(trainee, config, request, output, stamp, metadata, processes)
        return training.report(started, resumes=earlier is not None)


def replay(fault: Path) -> dict[str, float]:
    """Return the loss terms of the batch in `NAME.fault.safetensors`, computed again."""
    found = read_fault(fault, STAGE)
    settings = dict(found.settings)
    method = trained_peer(str(settings.pop("method", "")))
    return method.replay(replace(found, settings=settings))


def peer_items(
    name: str,
    root: Path,
    output: Path,
    config: TrainBaselineConfig,
    split: str | None = None,
    camera: str | None = None,
) -> list[WorkItem]:
    """Return the work items of a root, one per scene and camera.

    Raises:
        MissingInputError: the root lacks labels that the method `name` needs.
        SymgraspError: the root has no scene of the split or the camera.
    """
    dataset = GraspNetRoot.finished(root)
    refuse_held_back(dataset)
    scenes = dataset.chosen_scenes(camera, split)
    needs = trained_peer(name).peer.needs
    refuse_lacking(
        dataset, [frame for scene in scenes for frame in strided_frames(scene, 1)], needs
    )
    folder = output.with_name(f"{output.stem}.frames")
    network = asdict(config.network)
    settings = {"method": name, "network": network, "frame_stride": config.frame_stride}
    return [
        WorkItem(
            scene.name,
            folder / f"{scene.name}.h5",
            make_stamp(STAGE, settings, inputs=inputs | labels_of(dataset, scene, needs)),
            (scene,),
        )
        for scene, inputs in zip(scenes, inputs_of_scenes(dataset, scenes), strict=True)
    ]


def _prepare_scene(
    item: WorkItem, root: GraspNetRoot, peer: str, config: TrainBaselineConfig
) -> str:
    """Write the frames of one scene as inputs and targets of `peer`; return the count."""
    (scene,) = item.arguments
    frames = strided_frames(scene, config.frame_stride)
    prepare = trained_peer(peer).peer.prepare
    write_peer_frames(
        item.target, [prepare(root, frame, config.network) for frame in frames], item.stamp
    )
    return counted(len(frames), "frame")
