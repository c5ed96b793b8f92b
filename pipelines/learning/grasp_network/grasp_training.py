"""The grasp network as a `Trainee`: data, Siamese loss, figures (Sec. III-E)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn

from pipelines.array_types import Indices
from pipelines.configs import TrainConfig, from_settings
from pipelines.geometry.symmetry import SPHERE_SLOT
from pipelines.learning.grasp_network.region_figures import RegionFigures
from pipelines.learning.grasp_network.region_sources import RegionSet, TrainingRegions
from pipelines.learning.loop.faults import Fault
from pipelines.learning.loop.loaders import load_regions
from pipelines.learning.speed.micro_batches import micro_batch_size
from pipelines.learning.speed.processes import Processes
from pipelines.network.cpu.folding import folded
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.sampling import gather
from pipelines.network.training.augmentation import augment, scaled_copy
from pipelines.network.training.losses import NUM_ERROR_POINTS, total_loss
from pipelines.network.training.region_batch import RegionBatch
from pipelines.network.weights_files import fill

VALIDATION_BATCH = 12
OWN = ("query", "measured")  # tensors of a sample, in addition to its regions and their copies
COPY = "copy_"  # prefix of the names of the copies' tensors
CPU_MICRO_BATCH = 6  # regions; the fastest number for two threads


@dataclass(frozen=True)
class Sample:
    """Augmented regions of a training step, which draws nothing further at random."""

    regions: RegionBatch  # (B, N) points, the initial branch
    # The same points and labels, scaled along a principal direction.
    copies: RegionBatch
    query: Tensor  # (B, Q) the points with a prediction
    measured: Tensor  # (B, S) the points on which dense errors are measured

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by name."""
        copies = {COPY + name: tensor for name, tensor in vars(self.copies).items()}
        return {name: getattr(self, name) for name in OWN} | dict(vars(self.regions)) | copies

    @classmethod
    def of(cls, tensors: Mapping[str, Tensor]) -> "Sample":
        """Return the sample of the result of `tensors`."""
        names = RegionBatch.__dataclass_fields__
        regions, copies = (
            RegionBatch(*(tensors[before + name] for name in names)) for before in ("", COPY)
        )
        return cls(regions, copies, *(tensors[name] for name in OWN))


class GraspTraining:
    """A `Trainee`: the network with its training regions and its validation regions."""

    best_by = "loss"
    higher_is_better = False

    def __init__(
        self,
        module: SymmetryGraspNet,
        train_set: TrainingRegions,
        val_set: RegionSet,
        config: TrainConfig,
        device: torch.device,
        processes: Processes | None = None,
    ) -> None:
        self.module = module.to(device)
        self.train_set, self.val_set = train_set, val_set
        self.config, self.device = config, device
        self.parallel = device.type == "cpu"
        on_cpu = CPU_MICRO_BATCH if self.parallel else 0
        self.micro_batch_size = micro_batch_size(config, on_cpu, processes or Processes())

    def epoch(self, number: int, rng: np.random.Generator) -> Sequence[Indices]:
        """Return the items of one epoch's batches of regions."""
        return self.train_set.epoch(number, rng)

    def load(self, items: Indices, generators: Sequence[np.random.Generator]) -> Sample:
        """Return augmented regions and a scaled copy of each region."""
        regions = self.train_set.load(items, generators)
        return augmented(regions, self.config, generators)

    def loss(
        self, module: nn.Module, micro_batch: Sample, generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return the terms of the loss; nothing is drawn."""
        del generator
        return sample_loss(cast(SymmetryGraspNet, module), micro_batch, self.config, self.device)

    def tensors(self, micro_batch: Sample) -> dict[str, Tensor]:
        """Return a micro-batch as named tensors."""
        return micro_batch.tensors()

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the balanced loss on held-out regions, unaugmented, and `RegionFigures`.

        The loss as printed would choose weights that predict no affordance, its weight in Eq. 7.
        """
        figures, losses, weights = RegionFigures(), [], []
        module = folded(self.module)  # the same outputs in less time
        chosen, network = self.val_set.indices, self.config.network
        balanced = replace(self.config, loss="balanced")
        for start in range(0, len(chosen), VALIDATION_BATCH):
            indices = chosen[start : start + VALIDATION_BATCH]
            generators = [np.random.default_rng(int(index)) for index in indices]
            loaded = load_regions(self.val_set.reader, indices, network, generators)
            truth = loaded.to(self.device)
            prediction = module(truth.points, truth.ground, camera=truth.camera)
            points = truth.points[:, :: max(1, network.num_points // NUM_ERROR_POINTS)]
            terms = total_loss(prediction, truth, None, balanced, points)
            losses.append(float(terms["total"]))
            if not math.isfinite(losses[-1]):  # the figures need finite predictions
                return {"loss": math.nan}
            weights.append(len(truth))
            figures.add(prediction, truth)
        return {"loss": float(np.average(losses, weights=weights)), **figures.figures()}


def augmented(
    regions: RegionBatch, config: TrainConfig, generators: Sequence[np.random.Generator]
) -> Sample:
    """Return regions in random views, scaled copies, and the points with a prediction."""
    initial = augment(regions, config.augmentation, generators)
    copies = scaled_copy(initial, config.augmentation, generators)
    count = regions.points.shape[1]
    chosen = np.stack([each.permutation(count) for each in generators])
    measured = np.stack([each.permutation(count)[:NUM_ERROR_POINTS] for each in generators])
    query = np.ascontiguousarray(chosen[:, : config.num_loss_points])
    return Sample(initial, copies, torch.from_numpy(query), torch.from_numpy(measured))


def sample_loss(
    network: SymmetryGraspNet, sample: Sample, config: TrainConfig, device: torch.device
) -> dict[str, Tensor]:
    """Return the terms of the loss of one micro-batch by name, `total` among them.

    Both branches learn from labels, without Siamese training separately (Sec. IV-D). A scaled
    sphere has no label, so only the features of such a copy count.
    """
    both = RegionBatch.joined(sample.regions, sample.copies).to(device)
    query, measured = (
        torch.cat([each, each]).to(device) for each in (sample.query, sample.measured)
    )
    features = network.features(both.points, both.ground, query, both.camera)
    initial, scaled = features.values.chunk(2)
    pair = (initial, scaled) if config.use_siamese else None
    is_labelled = both.existence[:, SPHERE_SLOT] == 0
    is_labelled[: len(sample.regions)] = True
    points = gather(both.points, measured)
    return total_loss(
        network.predict(features),
        both.at(query),
        pair,
        config,
        points,
        is_labelled.to(points.dtype),
    )


def replay(fault: Fault) -> dict[str, float]:
    """Return the loss terms of a kept micro-batch, on the CPU."""
    config = from_settings(TrainConfig, fault.settings)
    network = SymmetryGraspNet(config.network)
    fill(network, fault.weights, fault.path)
    terms = sample_loss(network.train(), Sample.of(fault.batch), config, torch.device("cpu"))
    return {name: float(term.detach()) for name, term in terms.items()}
