"""SymmetryNet as a `Trainee`: regions, and the targets of each of their points."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from pipelines.configs.peers import PeerSchedule
from pipelines.dataset.training.region_frames import FileRows, FrameSets
from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.learning.detector.detector_training import spread
from pipelines.learning.peers.peer import Drawn, Peer, PeerTraining, drawn_batches, mean_figures
from pipelines.learning.peers.symmetrynet_regions import (
    NUM_PASTED,
    LabelledCrop,
    RegionCrops,
    drawn_region,
    plain_region,
    read_regions,
    stacked_regions,
    symmetrynet_frame,
)
from pipelines.network.peers.symmetrynet import (
    SYMMETRY_MODES,
    SYMMETRYNET_SIZES,
    UNIT,
    SymmetryNet,
    SymmetryOutput,
)
from pipelines.network.peers.symmetrynet_input import normalised_colors
from pipelines.network.training.matching import NUM_REFLECTIONS, assign

ROUNDING = 0.01  # metres, added to the length that an error is divided by
EXISTENCE_WEIGHT, CONSISTENCY_WEIGHT = 2.0, 0.5
NONE = 1e-6  # lengths and probabilities below this value count as 0
JUDGED_TOGETHER = 16  # regions of a batch of validation


def _numbered(keys: FileRows) -> list[tuple[int, int]]:
    """Return the frame of each region and the region's row in the frame."""
    return [(i, row) for i, key in enumerate(keys) for row in range(len(read_regions(*key)))]


def symmetry_terms(
    module: nn.Module,
    seen: RegionCrops,
    device: torch.device,
    generator: torch.Generator | None = None,
) -> dict[str, Tensor]:
    """Return the mean loss terms of regions, and their weighted sum as `total`."""
    seen = seen.to(device)
    found: SymmetryOutput = module(
        normalised_colors(seen.image, seen.jitter), seen.pixels, seen.points
    )
    exists = seen.existence > 0
    has_axis, has_any = exists[:, ROTATION_SLOT], exists.any(dim=1)
    terms, has_plane = _plane_terms(found, seen)
    counts = seen.existence.sum(dim=1, keepdim=True).clamp(min=1.0)
    center = (seen.place.sum(dim=1) / counts)[:, None] - seen.points
    axis, on_axis = seen.direction[:, None, ROTATION_SLOT], seen.place[:, None, ROTATION_SLOT]
    foot = on_axis - seen.points
    foot = foot - (foot * axis).sum(-1, keepdim=True) * axis
    along = (found.axis_foot * axis).sum(-1) / UNIT
    terms["consistency"] = terms["consistency"] + (along.square().mean(dim=1) * has_axis).mean()
    existence = found.existence.mean(dim=1).clamp(NONE, 1.0 - NONE)
    wanted = has_plane.float()
    likelihood = wanted * existence.log() + (1.0 - wanted) * (1.0 - existence).log()
    terms |= {
        "center": (_length(found.center - center).mean(dim=1) * has_any).mean() / UNIT,
        "axis": (_length(found.axis_foot - foot).mean(dim=1) * has_axis).mean() / UNIT,
        "existence": -likelihood.mean(),
        "mode": functional.cross_entropy(found.mode.mean(dim=1), true_modes(exists)),
    }
    total = terms["center"] + terms["mirrored"] + terms["feet"] + terms["axis"] + terms["mode"]
    total = total + EXISTENCE_WEIGHT * terms["existence"]
    return {"total": total + CONSISTENCY_WEIGHT * terms["consistency"]} | terms


def _plane_terms(found: SymmetryOutput, seen: RegionCrops) -> tuple[dict[str, Tensor], Tensor]:
    """Return the terms of the planes, and whether each predicted plane (B, 3) has a true plane."""
    exists, normal = seen.existence[:, :NUM_REFLECTIONS] > 0, seen.direction[:, :NUM_REFLECTIONS]
    across = (
        (seen.points[:, :, None] - seen.place[:, None, :NUM_REFLECTIONS]) * normal[:, None]
    ).sum(-1)
    with torch.no_grad():
        predicted = functional.normalize(found.mirrored, dim=-1, eps=NONE)
        cosine = torch.einsum("bnsc,bpc->bnsp", predicted, normal).abs()
        cost = cosine.clamp(max=1.0).acos().mean(dim=1)  # (B, slot, plane)
        order = assign(torch.where(exists[:, None], cost, 0.0))
    assigned = exists.gather(1, order)
    normal = normal.gather(1, order[..., None].expand(-1, -1, 3))
    across = across.gather(2, order[:, None].expand(-1, across.shape[1], -1))
    foot = -across[..., None] * normal[:, None]  # (B, N, slot, 3)
    wrong = _length(found.mirrored - 2.0 * foot) / (2.0 * across.abs() + ROUNDING)
    half = ((found.feet - 0.5 * found.mirrored) / UNIT).square().sum(-1)
    errors = {"mirrored": wrong, "feet": _length(found.feet - foot) / UNIT, "consistency": half}
    terms = {
        name: (error.mean(dim=1) * assigned).sum(dim=1).mean() for name, error in errors.items()
    }
    return terms, assigned


def true_modes(exists: Tensor) -> Tensor:
    """Return the number (B,) in `SYMMETRY_MODES` of regions with the slots `exists` (B, 5).

    Without a plane, an axis or a sphere it is the number of `plane`.
    """
    plane, axis = exists[:, :NUM_REFLECTIONS].any(dim=1), exists[:, ROTATION_SLOT]
    mode = torch.where(
        axis, SYMMETRY_MODES.index("axis") + plane.long(), SYMMETRY_MODES.index("plane")
    )
    return torch.where(exists[:, SPHERE_SLOT], SYMMETRY_MODES.index("sphere"), mode)


def _length(vectors: Tensor) -> Tensor:
    length: Tensor = torch.linalg.vector_norm(vectors, dim=-1)
    return length


class SymmetryNetTraining(PeerTraining):
    """A `Trainee`: SymmetryNet with its training regions and its validation regions."""

    peer = Peer(
        schedule=PeerSchedule(
            steps=4000, epoch_steps=200, batch_size=8, learning_rate=3e-4, decay_steps=1500
        ),
        needs=("symmetry",),
        build=SymmetryNet,
        prepare=symmetrynet_frame,
        item=RegionCrops,
        terms=symmetry_terms,
        cpu_micro_batch=4,  # regions
    )

    def choose_items(self) -> None:
        """Number the regions of the frames; leave out validation frames without a region.

        Raises:
            ValueRangeError: no region has enough visible points.
        """
        self.num_points = SYMMETRYNET_SIZES[self.config.network.variant].num_points
        self.regions = _numbered(self.frames.train)
        val = [key for key in self.frames.val if read_regions(*key)]
        self.frames = FrameSets(self.frames.train, val)
        if not self.regions or not val:
            expected = "at least 1 to train on and 1 to validate on"
            raise ValueRangeError("number of regions that are seen well enough", 0, expected)

    def epoch(self, number: int, rng: np.random.Generator) -> Sequence[NDArray[np.int64]]:
        """Return the batches of region numbers until the next validation."""
        return drawn_batches(len(self.regions), self.config, number, rng)

    def examples(self, drawn: Drawn) -> RegionCrops:
        """Return each region with the points and the noise that its generator draws."""
        return stacked_regions([self._example(region, rng) for region, rng in drawn])

    def _example(
        self, region: LabelledCrop, rng: np.random.Generator
    ) -> tuple[NDArray[np.generic], ...]:
        others = rng.integers(len(self.regions), size=NUM_PASTED).tolist()
        return drawn_region(region, [self.source(each) for each in others], self.num_points, rng)

    def source(self, number: int) -> LabelledCrop:
        """Return the training region `number`."""
        frame, row = self.regions[number]
        return read_regions(*self.frames.train[frame])[row]

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the loss terms on the regions of the validation frames, unchanged."""
        found, counts = [], []
        for batch in self._validation_regions():
            found.append(symmetry_terms(self.module, batch, self.device))
            counts.append(len(batch.points))
        return mean_figures(found, counts)

    def _validation_regions(self) -> Iterator[RegionCrops]:
        keys = spread(self.frames.val, self.config.max_val_frames)
        regions = [each for key in keys for each in read_regions(*key)]
        for start in range(0, len(regions), JUDGED_TOGETHER):
            some = regions[start : start + JUDGED_TOGETHER]
            yield stacked_regions([plain_region(each, self.num_points) for each in some])
