"""The region detector as a `Trainee`: frames, Mask R-CNN's losses, mask AP."""

from collections.abc import Iterable, Mapping, Sequence
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision.models.detection import MaskRCNN

from pipelines.array_types import Mask
from pipelines.configs import FinetuneDetectorConfig, from_settings
from pipelines.dataset.training import detector_frames
from pipelines.dataset.training.region_frames import FileRows, FrameSets
from pipelines.learning.detector.frame_views import (
    DetectorExample,
    as_example,
    masks_of,
    random_example,
)
from pipelines.learning.loop.faults import Fault, numbered, unnumbered
from pipelines.learning.loop.loaders import epoch_batches
from pipelines.learning.speed.micro_batches import micro_batch_size
from pipelines.learning.speed.processes import Processes
from pipelines.metrics.coco_masks import coco_average_precision, match_masks
from pipelines.network.detection.detector import draw_mask
from pipelines.network.detection.mask_rcnn import build_detector, seed_samplers
from pipelines.network.weights_files import fill

CPU_MICRO_BATCH = 2  # frames


class DetectorTraining:
    """A `Trainee`: the detector with its training frames and its validation frames."""

    best_by = "mask_ap50"
    higher_is_better = True

    def __init__(
        self,
        module: MaskRCNN,
        frames: FrameSets,
        config: FinetuneDetectorConfig,
        device: torch.device,
        processes: Processes | None = None,
    ) -> None:
        self.module: nn.Module = module.to(device, memory_format=torch.channels_last)
        self.frames, self.config, self.device = frames, config, device
        self.parallel = device.type == "cpu"
        on_cpu = CPU_MICRO_BATCH if self.parallel else 0
        self.micro_batch_size = micro_batch_size(config, on_cpu, processes or Processes())

    def epoch(self, number: int, rng: np.random.Generator) -> Sequence[NDArray[np.int64]]:
        """Return one epoch's batches of frame numbers."""
        del number  # every epoch shows all frames
        return epoch_batches(range(len(self.frames.train)), self.config.batch_size, rng)

    def load(
        self, items: NDArray[np.int64], generators: Sequence[np.random.Generator]
    ) -> list[DetectorExample]:
        """Return random views of frames."""
        examples = []
        for number, rng in zip(items, generators, strict=True):
            frame = detector_frames.read(*self.frames.train[int(number)])
            examples.append(random_example(frame, self.config.detector.input, rng))
        return examples

    def loss(
        self, module: nn.Module, micro_batch: list[DetectorExample], generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return Mask R-CNN's five losses, and their sum as `total`."""
        return frames_loss(cast(MaskRCNN, module), micro_batch, generator, self.device)

    def tensors(self, micro_batch: list[DetectorExample]) -> dict[str, Tensor]:
        """Return a micro-batch as named tensors, NUMBER.NAME."""
        return numbered([{"image": each.image} | each.target for each in micro_batch])

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return mask AP on (at most `max_val_frames` of) the held-out frames."""
        frames, threshold = [], self.config.detector.mask_threshold
        for key in spread(self.frames.val, self.config.max_val_frames):
            view = detector_frames.read(*key)
            example = as_example(view, self.config.detector.input)
            (found,) = self.module([example.image.to(self.device)])
            size = view.regions.shape
            drawn = [
                draw_mask(soft, box.astype(np.float64), (size[0], size[1]), threshold)
                for soft, box in zip(
                    found["masks"][:, 0].cpu().numpy(), found["boxes"].cpu().numpy(), strict=True
                )
            ]
            masks = np.array(drawn, bool).reshape(-1, *size)
            frames.append((masks_of(view.regions), masks, found["scores"].cpu().numpy()))
        return mask_figures(frames)


def spread(keys: FileRows, most: int) -> FileRows:
    """Return `keys`, or `most` of them, evenly spread, if there are more."""
    count = min(len(keys), most)
    return [keys[i * len(keys) // count] for i in range(count)]


def mask_figures(frames: Iterable[tuple[Mask, Mask, NDArray[np.floating]]]) -> dict[str, float]:
    """Return AP at IoU 0.5, AP averaged over IoU 0.5 to 0.95, and recall at IoU 0.5.

    `frames`: for each frame its true masks (n, h, w), found masks (m, h, w) and confidence (m,).
    """
    num_truth, right = 0, list[Mask]()
    confidence: list[NDArray[np.floating]] = []
    for truth, found, sure in frames:
        num_truth += len(truth)
        confidence.append(sure)
        right.append(match_masks(list(found), sure.tolist(), list(truth)))
    if not num_truth or not sum(map(len, confidence)):
        return {"mask_ap50": 0.0, "mask_ap": 0.0, "mask_recall50": 0.0}
    hits = np.concatenate(right, axis=1)
    precision = coco_average_precision(np.concatenate(confidence), hits, num_truth)
    return {
        "mask_ap50": float(precision[0]),
        "mask_ap": float(precision.mean()),
        "mask_recall50": float(hits[0].sum() / num_truth),
    }


def frames_loss(
    detector: MaskRCNN,
    examples: Sequence[DetectorExample],
    generator: torch.Generator,
    device: torch.device,
) -> dict[str, Tensor]:
    """Return Mask R-CNN's five losses by name, and their sum as `total`."""
    seed_samplers(detector, generator)
    images = [example.image.to(device) for example in examples]
    targets = [
        {name: each.to(device) for name, each in example.target.items()} for example in examples
    ]
    terms: dict[str, Tensor] = detector(images, targets)
    return {"total": torch.stack(list(terms.values())).sum()} | {
        name.removeprefix("loss_"): term for name, term in terms.items()
    }


def replay(fault: Fault) -> dict[str, float]:
    """Return the loss terms of a kept micro-batch, on the CPU."""
    config = from_settings(FinetuneDetectorConfig, fault.settings)
    detector = build_detector(config.detector)
    fill(detector, fault.weights, fault.path)
    examples = [
        DetectorExample(each["image"], {name: each[name] for name in ("boxes", "labels", "masks")})
        for each in unnumbered(fault.batch)
    ]
    terms = frames_loss(detector.train(), examples, fault.generator(), torch.device("cpu"))
    return {name: float(term.detach()) for name, term in terms.items()}
