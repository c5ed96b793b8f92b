"""The grasp network as the training engine sees it: data, Siamese loss, figures (Sec. III-E)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn

from pipelines.configs import TrainConfig
from pipelines.formats.packed_regions import PackedReader
from pipelines.learning.loaders import Indices, epoch_batches, load_regions
from pipelines.learning.region_figures import RegionFigures
from pipelines.network.augmentation import augment, scaled_copy
from pipelines.network.losses import NUM_ERROR_POINTS, LossTerms, total_loss
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.regions import RegionBatch

VALIDATION_BATCH = 12


@dataclass(frozen=True)
class RegionSet:
    """Some of the regions of a packed folder."""

    reader: PackedReader
    indices: Indices


class GraspTraining:
    """A `Trainee`: the network with the regions it learns from and those it is judged on."""

    best_by = "loss"
    higher_is_better = False

    def __init__(
        self,
        module: SymmetryGraspNet,
        train_set: RegionSet,
        val_set: RegionSet,
        config: TrainConfig,
        device: torch.device,
    ) -> None:
        self.module = module.to(device)
        self.train_set, self.val_set = train_set, val_set
        self.config, self.device = config, device
        self.parallel = device.type == "cpu"

    def epoch(self, rng: np.random.Generator) -> Sequence[Indices]:
        """Return one epoch's batches of region indices."""
        return epoch_batches(self.train_set.indices, self.config.batch_size, rng)

    def load(self, batch: Indices, rng: np.random.Generator) -> list[tuple[float, RegionBatch]]:
        """Return a batch's regions, cut into micro-batches."""
        points = self.config.network.num_points
        regions = load_regions(self.train_set.reader, batch, points, rng)
        size = self.config.micro_batch_size if self.parallel else len(regions)
        pieces = [regions[i : i + size] for i in range(0, len(regions), size)]
        return [(len(piece) / len(regions), piece) for piece in pieces]

    def loss(
        self, module: nn.Module, micro_batch: RegionBatch, generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return the loss of augmented regions and, with Siamese training, of a scaled copy.

        Without it the network sees the initial or the scaled points, as separate samples
        (Table IV); of a scaled sphere no label is left, so spheres are not scaled then.
        """
        config = self.config
        initial = augment(micro_batch, config.augmentation, generator)
        if config.use_siamese:
            copy = scaled_copy(initial, config.augmentation, generator)
            terms = self._terms(module, initial, copy, generator)
        else:
            scaled = scaled_copy(initial, config.augmentation, generator, spheres=False)
            terms = self._terms(module, initial.mixed(scaled, generator), None, generator)
        return {name: getattr(terms, name) for name in terms.__dataclass_fields__}

    def _terms(
        self,
        module: nn.Module,
        initial: RegionBatch,
        copy: RegionBatch | None,
        generator: torch.Generator,
    ) -> LossTerms:
        """Return the loss at some of the points; `module` is a copy of the network."""
        network = cast(SymmetryGraspNet, module)
        size, count = initial.points.shape[:2]
        query = torch.rand(size, count, generator=generator).argsort(1)
        measured = torch.randperm(count, generator=generator)[:NUM_ERROR_POINTS]
        query = query[:, : self.config.num_loss_points].to(self.device)
        initial = initial.to(self.device)
        truth, points = initial.at(query), initial.points[:, measured.to(self.device)]
        if copy is None:
            prediction = network(initial.points, query)
            return total_loss(prediction, truth, None, self.config, points)
        both = torch.cat([initial.points, copy.points.to(self.device)])
        features = network.features(both, torch.cat([query, query]))
        prediction = network.predict(features[:size])
        return total_loss(prediction, truth, features[size:], self.config, points)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the loss on the held-out regions, unaugmented, and `RegionFigures`."""
        figures, losses, weights = RegionFigures(), [], []
        chosen, count = self.val_set.indices, self.config.network.num_points
        for start in range(0, len(chosen), VALIDATION_BATCH):
            indices = chosen[start : start + VALIDATION_BATCH]
            rng = np.random.default_rng(start)
            truth = load_regions(self.val_set.reader, indices, count, rng).to(self.device)
            prediction = self.module(truth.points)
            points = truth.points[:, :: max(1, count // NUM_ERROR_POINTS)]
            losses.append(float(total_loss(prediction, truth, None, self.config, points).total))
            weights.append(len(truth))
            figures.add(prediction, truth)
        return {"loss": float(np.average(losses, weights=weights)), **figures.figures()}
