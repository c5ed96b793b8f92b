"""The region detector as the training engine sees it: frames, Mask R-CNN's losses, mask AP."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision.models.detection import MaskRCNN

from pipelines.configs import FinetuneDetectorConfig
from pipelines.formats import detector_frames
from pipelines.learning.frame_views import DetectorExample, as_example, masks_of, random_view
from pipelines.learning.loaders import epoch_batches
from pipelines.learning.mask_figures import MaskFigures
from pipelines.network.detector import draw_mask
from pipelines.network.mask_rcnn import seed_samplers

Keys = Sequence[tuple[Path, int]]  # file and row of each frame


@dataclass(frozen=True)
class FrameSets:
    """Frames to train on and frames of other scenes to validate on."""

    train: Keys
    val: Keys


class DetectorTraining:
    """A `Trainee`: the detector with the frames it learns from and those it is judged on."""

    best_by = "mask_ap50"
    higher_is_better = True

    def __init__(
        self,
        module: MaskRCNN,
        frames: FrameSets,
        config: FinetuneDetectorConfig,
        device: torch.device,
    ) -> None:
        self.module: nn.Module = module.to(device, memory_format=torch.channels_last)
        self.frames, self.config, self.device = frames, config, device
        self.parallel = device.type == "cpu"

    def epoch(self, rng: np.random.Generator) -> Sequence[NDArray[np.int64]]:
        """Return one epoch's batches of frame numbers."""
        return epoch_batches(range(len(self.frames.train)), self.config.batch_size, rng)

    def load(
        self, batch: NDArray[np.int64], rng: np.random.Generator
    ) -> list[tuple[float, list[DetectorExample]]]:
        """Return random views of a batch's frames, cut into micro-batches."""
        examples = []
        for number in batch:
            frame = detector_frames.read(*self.frames.train[int(number)])
            examples.append(as_example(random_view(frame, rng), self.config.detector.input))
        size = self.config.micro_batch_size if self.parallel else len(examples)
        pieces = [examples[i : i + size] for i in range(0, len(examples), size)]
        return [(len(piece) / len(examples), piece) for piece in pieces]

    def loss(
        self, module: nn.Module, micro_batch: list[DetectorExample], generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return Mask R-CNN's five losses, and their sum as `total`."""
        detector = cast(MaskRCNN, module)
        seed_samplers(detector, generator)
        images = [example.image.to(self.device) for example in micro_batch]
        targets = [
            {name: each.to(self.device) for name, each in example.target.items()}
            for example in micro_batch
        ]
        terms: dict[str, Tensor] = detector(images, targets)
        names = {name: name.removeprefix("loss_") for name in terms}
        return {"total": torch.stack(list(terms.values())).sum()} | {
            names[name]: term for name, term in terms.items()
        }

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return mask AP on (at most `max_val_frames` of) the held-out frames."""
        figures = MaskFigures()
        step = max(1, len(self.frames.val) // self.config.max_val_frames)
        for key in self.frames.val[::step]:
            view = detector_frames.read(*key)
            example = as_example(view, self.config.detector.input)
            (found,) = self.module([example.image.to(self.device)])
            size = view.regions.shape
            drawn = [
                draw_mask(soft, box.astype(np.float64), (size[0], size[1]))
                for soft, box in zip(
                    found["masks"][:, 0].cpu().numpy(), found["boxes"].cpu().numpy(), strict=True
                )
            ]
            masks = np.stack(drawn) if drawn else np.zeros((0, *size), bool)
            figures.add(masks_of(view.regions), masks, found["scores"].cpu().numpy())
        return figures.figures()
