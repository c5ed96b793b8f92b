"""Training of a compared method by `train-baseline`, and the method's training frames."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipelines.array_types import Array, Mask
from pipelines.configs import TrainBaselineConfig, from_settings
from pipelines.configs.peers import PeerNetworkConfig, PeerSchedule
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles
from pipelines.dataset.scene_digests import digest_of_images
from pipelines.dataset.training.region_frames import FileRows, FrameSets, strided_frames
from pipelines.errors import MissingInputError, ValueRangeError
from pipelines.learning.detector.detector_training import spread
from pipelines.learning.loop.faults import Fault, numbered, unnumbered
from pipelines.learning.loop.loaders import epoch_batches
from pipelines.learning.loop.trainee import MicroBatch
from pipelines.learning.speed.micro_batches import micro_batch_size
from pipelines.learning.speed.processes import Processes
from pipelines.network.weights_files import fill
from pipelines.storage.h5_columns import check_version
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1
STORABLE = 3.2767  # metres along an axis: the farthest of tenths of a millimetre in 16 bits
KEPT = 2048  # frames kept in memory after reading

Arrays = dict[str, NDArray[Any]]
Drawn = Sequence[tuple[Any, np.random.Generator]]  # items with their generators


def refuse_lacking(root: GraspNetRoot, frames: Sequence[FrameFiles], needs: Sequence[str]) -> None:
    """Raise MissingInputError if the root has none of the labels that a method `needs`.

    Names: `rect` and `collision_label`, which come together; `grasp_label`; `symmetry`.
    """
    made_by = "symgrasp synthesize OUT --collision-labels"
    for need in needs:
        if need == "rect":
            if not any(frame.path("rect").is_file() for frame in frames):
                raise MissingInputError(root.root / "scenes/scene_NNNN/CAMERA/rect", made_by)
        elif not any((root.root / need).glob("*")):
            by_itself = need == "symmetry"
            maker = f"symgrasp annotate-symmetry {root.root}" if by_itself else made_by
            raise MissingInputError(root.root / need, maker)


def labels_of(root: GraspNetRoot, scene: SceneFiles, needs: Sequence[str]) -> dict[str, str]:
    """Return digests of the names and sizes of the labels of a scene that a method `needs`."""
    files: dict[str, list[Path]] = {
        "rect": [frame.path("rect") for frame in strided_frames(scene, 1)],
        "collision_label": [root.collision_label_path(scene.scene_id)],
        "grasp_label": [root.grasp_label_path(i) for i in scene.object_ids],
        "symmetry": [root.symmetry_path(i) for i in scene.object_ids],
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


def storable(points: Array) -> Mask:
    """Return which of `points` (..., 3), metres, can be stored; farther ones would come near."""
    return np.asarray((np.abs(points) <= STORABLE).all(axis=-1))


@lru_cache(maxsize=KEPT)
def read_peer_frame(path: Path, row: int) -> Arrays:
    """Read the arrays of one frame; they are shared and must not be changed."""
    with open_h5(path) as file:
        return {name: each[()] for name, each in file[f"{row:04d}"].items()}


def labelled(keys: FileRows, name: str) -> FileRows:
    """Return the frames with a non-empty array `name` of labels.

    Raises:
        ValueRangeError: all frames lack labels.
    """
    kept = [key for key in keys if len(read_peer_frame(*key)[name])]
    if not kept:
        expected = "at least 1; a root with more grasp points (--grasp-points 400) has some"
        raise ValueRangeError("number of frames with a visible labelled grasp", 0, expected)
    return kept


def drawn_batches(
    count: int, config: TrainBaselineConfig, number: int, rng: np.random.Generator
) -> list[NDArray[np.int64]]:
    """Return the batches of epoch `number`: `epoch_steps` batches, or the rest of `steps`.

    All `count` items are used before an item is repeated.
    """
    steps = min(config.epoch_steps, config.steps - number * config.epoch_steps)
    batches: list[NDArray[np.int64]] = []
    while len(batches) < steps:
        batches += epoch_batches(range(count), config.batch_size, rng)
    return batches[:steps]


@dataclass(frozen=True)
class Peer:
    """A compared method.

    Attributes:
        schedule: schedule of the training.
        needs: files of a root that the labels are made of, named as in `refuse_lacking`.
        build: makes the network; layers draw from torch's own generator.
        prepare: makes a frame's arrays, once; training adds everything random.
        item: dataclass of tensors; a micro-batch is one of these or a list of them.
        terms: computes the loss terms of a micro-batch, their weighted sum as `total`.
        cpu_micro_batch: items that a CPU works on together.
        labels: the array of labels that at least one frame must have; None for no check.
        learns_without: whether the method also learns from frames without labels.
        layout: memory format of the network's tensors.
    """

    schedule: PeerSchedule
    needs: tuple[str, ...]
    build: Callable[[PeerNetworkConfig], nn.Module]
    prepare: Callable[[GraspNetRoot, FrameFiles, PeerNetworkConfig], Arrays]
    item: Callable[..., Any]
    terms: Callable[[Any, Any, torch.device, torch.Generator], dict[str, Tensor]]
    cpu_micro_batch: int
    labels: str | None = None
    learns_without: bool = False
    layout: torch.memory_format = torch.preserve_format


class PeerTraining(ABC):
    """A `Trainee`: the network of a compared method with its training frames."""

    peer: ClassVar[Peer]
    best_by = "loss"
    higher_is_better = False

    def __init__(
        self,
        frames: FrameSets,
        config: TrainBaselineConfig,
        device: torch.device,
        processes: Processes,
    ) -> None:
        peer = self.peer
        self.frames, self.config, self.device = frames, config, device
        self.choose_items()
        network: Any = peer.build(config.network)
        self.module: nn.Module = network.to(device, memory_format=peer.layout)
        self.parallel = device.type == "cpu"
        on_cpu = peer.cpu_micro_batch if self.parallel else 0
        self.micro_batch_size = micro_batch_size(config, on_cpu, processes)

    def choose_items(self) -> None:
        """Leave out frames without labels, if the method cannot learn from them.

        Raises:
            ValueRangeError: no frame has labels.
        """
        name = self.peer.labels
        if name is not None:
            train = labelled(self.frames.train, name)
            if not self.peer.learns_without:
                self.frames = FrameSets(train, labelled(self.frames.val, name))

    @abstractmethod
    def examples(self, drawn: Drawn) -> MicroBatch:
        """Return the micro-batch of the items `drawn`, each with its generator."""

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Return validation figures, by name, of the module with its present weights."""

    @classmethod
    def replay(cls, fault: Fault) -> dict[str, float]:
        """Return the loss terms of a kept micro-batch, on the CPU."""
        network = cls.peer.build(from_settings(TrainBaselineConfig, fault.settings).network)
        fill(network, fault.weights, fault.path)
        of_items = any("." in name for name in fault.batch)
        items = [cls.peer.item(**each) for each in unnumbered(fault.batch)] if of_items else None
        batch = items or cls.peer.item(**fault.batch)
        terms = cls.peer.terms(network.train(), batch, torch.device("cpu"), fault.generator())
        return {name: float(term.detach()) for name, term in terms.items()}

    def loss(
        self, module: nn.Module, micro_batch: MicroBatch, generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return the loss terms by name, and their weighted sum as `total`."""
        return self.peer.terms(module, micro_batch, self.device, generator)

    def tensors(self, micro_batch: MicroBatch) -> dict[str, Tensor]:
        """Return a micro-batch as named tensors; names are NUMBER.NAME for a list of items."""
        if isinstance(micro_batch, list):
            return numbered([vars(each) for each in micro_batch])
        return dict(vars(micro_batch))

    def epoch(self, number: int, rng: np.random.Generator) -> Sequence[NDArray[np.int64]]:
        """Return the batches of frame numbers until the next validation."""
        return drawn_batches(len(self.frames.train), self.config, number, rng)

    def load(
        self, items: NDArray[np.int64], generators: Sequence[np.random.Generator]
    ) -> MicroBatch:
        """Return the micro-batch of `items`, each drawing from its own generator."""
        pairs = zip(items.tolist(), generators, strict=True)
        return self.examples([(self.source(number), rng) for number, rng in pairs])

    def source(self, number: int) -> Any:  # noqa: ANN401 - the method's item
        """Return the arrays of the training frame `number`."""
        return read_peer_frame(*self.frames.train[number])

    def validation_frames(self) -> list[Arrays]:
        """Return at most `max_val_frames` validation frames, evenly spread."""
        return [
            read_peer_frame(*key) for key in spread(self.frames.val, self.config.max_val_frames)
        ]


def mean_figures(
    found: Sequence[Mapping[str, Tensor]], counts: Sequence[int] | None = None
) -> dict[str, float]:
    """Return the means of the loss terms of frames, `total` as `loss`.

    `counts`: number of items in each of `found`, if these are means of batches.
    """
    means = {
        name: float(np.average([float(each[name]) for each in found], weights=counts))
        for name in found[0]
    }
    return {"loss": means.pop("total")} | means
