"""A compared method as `train-baseline` sees it, and the frames that it learns from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pipelines.configs import TrainBaselineConfig
from pipelines.configs.peers import PeerNetworkConfig, PeerSchedule
from pipelines.dataset.graspnet.graspnet import FrameFiles, GraspNetRoot, SceneFiles
from pipelines.dataset.scene_digests import digest_of_images
from pipelines.errors import MissingInputError, ValueRangeError
from pipelines.learning.loop.faults import Fault
from pipelines.learning.loop.loaders import epoch_batches
from pipelines.learning.loop.trainee import Trainee
from pipelines.learning.speed.processes import Processes
from pipelines.storage.h5_columns import check_version
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1
KEPT = 2048  # frames kept in memory once they are read

Arrays = dict[str, NDArray[Any]]
FrameKeys = Sequence[tuple[Path, int]]  # file and row of each frame


@dataclass(frozen=True)
class PeerFrames:
    """Frames to train on and frames of other scenes to validate on."""

    train: FrameKeys
    val: FrameKeys


@dataclass(frozen=True)
class Peer:
    """A compared method.

    Attributes:
        model: name of its network in weights files.
        schedule: of its training.
        needs: files of a root that its labels are made of, as `needed` has them.
        prepare: makes a frame's arrays, once; everything random is left to the training.
        training: makes the trainee of the frames; layers draw from torch's own generator.
        replay: computes a kept micro-batch's loss terms again.
    """

    model: str
    schedule: PeerSchedule
    needs: tuple[str, ...]
    prepare: Callable[[GraspNetRoot, FrameFiles, PeerNetworkConfig], Arrays]
    training: Callable[[PeerFrames, TrainBaselineConfig, torch.device, Processes], Trainee]
    replay: Callable[[Fault], Mapping[str, float]]


def refuse_lacking(root: GraspNetRoot, frames: Sequence[FrameFiles], needs: Sequence[str]) -> None:
    """Raise MissingInputError if the root has none of the labels that a method `needs`.

    Names: `rect` and `collision_label`, which come with each other; `grasp_label`.
    """
    made_by = "symgrasp synthesize OUT --collision-labels"
    for need in needs:
        if need == "rect":
            if not any(frame.path("rect").is_file() for frame in frames):
                raise MissingInputError(root.root / "scenes/scene_NNNN/CAMERA/rect", made_by)
        elif not any((root.root / need).glob("*")):
            raise MissingInputError(root.root / need, made_by)


def labels_of(root: GraspNetRoot, scene: SceneFiles, needs: Sequence[str]) -> dict[str, str]:
    """Return digests of the names and sizes of the labels of a scene that a method `needs`."""
    files: dict[str, list[Path]] = {
        "rect": [frame.path("rect") for frame in scene.frames()],
        "collision_label": [root.collision_label_path(scene.scene_id)],
        "grasp_label": [root.grasp_label_path(i) for i in scene.object_ids],
    }
    return {need: digest_of_images(files[need]) for need in needs}


def write_peer_frames(path: Path, frames: Sequence[Arrays], stamp: Stamp) -> None:
    """Write the arrays of a scene's frames."""
    with new_h5(path) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["provenance"] = stamp.as_text()
        file.attrs["frames"] = len(frames)
        for row, arrays in enumerate(frames):
            for name, array in arrays.items():
                file.create_dataset(f"{row:04d}/{name}", data=array, track_times=False)


def count_peer_frames(path: Path) -> int:
    """Return the number of frames in a file of `write_peer_frames`."""
    with open_h5(path) as file:
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        return int(file.attrs["frames"])


@lru_cache(maxsize=KEPT)
def read_peer_frame(path: Path, row: int) -> Arrays:
    """Read the arrays of one frame; they are shared and must not be changed."""
    with open_h5(path) as file:
        return {name: each[()] for name, each in file[f"{row:04d}"].items()}


def refuse_unlabelled(keys: FrameKeys, name: str) -> None:
    """Raise ValueRangeError if the array `name` of labels is empty in all frames."""
    if not any(len(read_peer_frame(*key)[name]) for key in keys):
        expected = "at least 1; a root with more grasp points (--grasp-points 400) has some"
        raise ValueRangeError("number of labelled grasps that are seen", 0, expected)


def drawn_batches(
    count: int, config: TrainBaselineConfig, number: int, rng: np.random.Generator
) -> list[NDArray[np.int64]]:
    """Return the batches of epoch `number`: `epoch_steps` of them, or those left of `steps`.

    All `count` items come up before one comes again.
    """
    steps = min(config.epoch_steps, config.steps - number * config.epoch_steps)
    batches: list[NDArray[np.int64]] = []
    while len(batches) < steps:
        batches += epoch_batches(range(count), config.batch_size, rng)
    return batches[:steps]
