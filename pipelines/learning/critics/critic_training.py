"""A point critic as a `Trainee`: rows of candidates, their loss, figures of validation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.array_types import Array, Indices
from pipelines.configs import TrainCriticConfig, from_settings
from pipelines.errors import ValueRangeError, counted
from pipelines.grasping.critics.point_critic import (
    LAST_WIDTHS,
    POINT_WIDTHS,
    FeatureNames,
    PointCritic,
)
from pipelines.learning.critics.critic_rows import CriticRows
from pipelines.learning.critics.kinds import CriticKind
from pipelines.learning.critics.logistic import best_of_groups, log_loss, logistic_regression
from pipelines.learning.loop.faults import Fault
from pipelines.network.weights_files import fill

LEAST_SPREAD = 1e-2  # least spread of a feature: outliers in use must not outweigh the rest
MICRO_BATCHES = 4  # of a batch, which threads work on
CHUNK = 1024  # candidates that validation scores at a time


@dataclass(frozen=True)
class CriticBatch:
    """Candidates of one step; fields as in `CriticRows`, points drawn and disturbed."""

    points: Tensor  # (k, n, p)
    shared: Tensor  # (k, s)
    candidates: Tensor  # (k, c)
    truth: Tensor  # (k,)
    group: Tensor  # (k,)


class CriticModule(nn.Module):
    """The weights of a `PointCritic` as parameters, its standardisation as buffers."""

    def __init__(self, features: FeatureNames, mean: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.features = features
        shapes = features.weight_shapes()
        for name, widths in (("point", POINT_WIDTHS), ("last", LAST_WIDTHS)):
            sizes = (shapes[f"{name}.{index}.weight"] for index in range(len(widths)))
            layers = nn.ModuleList(nn.Linear(wide, narrow) for narrow, wide in sizes)
            self.add_module(name, layers)
        self.register_buffer("mean", mean)
        self.register_buffer("spread", spread)
        self.register_buffer("calibration", torch.tensor([0.0, 1.0]))

    def forward(
        self, batch: CriticBatch, dropout: Callable[[Tensor], Tensor] | None = None
    ) -> Tensor:
        """Return logits (k,) of the candidates of `batch`."""
        weights = dict(self.named_parameters()) | dict(self.named_buffers())
        critic = PointCritic(self.features, weights)
        logits: Tensor = critic.logits(batch.points, batch.shared, batch.candidates, torch, dropout)
        return logits

    def as_critic(self) -> PointCritic:
        """Return the critic with the present weights, in numpy."""
        state = {name: each.detach().cpu().numpy() for name, each in self.state_dict().items()}
        return PointCritic(self.features, state)


class CriticTraining:
    """A `Trainee`: a critic with the candidates that it learns from and held-out candidates."""

    best_by = "loss"
    higher_is_better = False
    parallel = True

    def __init__(
        self,
        kind: CriticKind,
        rows: CriticRows,
        held: CriticRows,
        config: TrainCriticConfig,
        seed: int = 0,
        *,
        start: PointCritic | None = None,
    ) -> None:
        for name, part in (("to learn from", rows), ("to calibrate on", held)):
            if not 0.0 < (part.truth.mean() if len(part) else 0.0) < 1.0:
                found = f"{counted(len(part), 'candidate')} {name}"
                raise ValueRangeError(found, "not both true and false", "some of both")
        self.rows, self.held, self.config = rows, held, config
        self.mirrored = list(kind.mirrored)
        columns = kind.features.candidate
        self.mirrored_candidates = [columns.index(name) for name in kind.mirrored_candidates]
        self.weight_choice = choice_weight(kind, config)
        self.micro_batch_size = max(1, config.batch_size // MICRO_BATCHES)
        if self.weight_choice > 0:  # an item is a group
            size = len(rows) / (len(np.unique(rows.group)) or 1)
            self.micro_batch_size = max(1, round(self.micro_batch_size / size))
        candidates = torch.from_numpy(rows.candidates)
        spread = candidates.std(0).clamp(min=LEAST_SPREAD)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)  # layers are initialised from torch's own generator
            self.module: nn.Module = CriticModule(kind.features, candidates.mean(0), spread)
        if start is not None:  # with the standardisation that its weights belong to
            state = {name: torch.from_numpy(each) for name, each in start.weights.items()}
            self.module.load_state_dict(state)

    def epoch(self, number: int, rng: np.random.Generator) -> list[list[Indices]]:
        """Return the batches of an epoch: lists of rows, or of groups of rows."""
        del number  # every epoch shows all rows
        group, size = self.rows.group, self.config.batch_size
        if self.weight_choice == 0:
            order = rng.permutation(len(group))
            starts = range(0, max(1, len(order) - size + 1), size)
            return [list(np.sort(order[i : i + size])[:, None]) for i in starts]
        members = np.split(np.arange(len(group)), np.flatnonzero(np.diff(group)) + 1)
        batches: list[list[Indices]] = [[]]
        for index in rng.permutation(len(members)):
            if sum(map(len, batches[-1])) >= size:
                batches.append([])
            batches[-1].append(members[index])
        return batches

    def load(
        self, items: Sequence[Indices], generators: Sequence[np.random.Generator]
    ) -> CriticBatch:
        """Return candidates `items` with some of their points, jittered and mirrored at random."""
        chosen, rng, config = np.concatenate(items), generators[0], self.config
        rows = self.rows[chosen]
        total = rows.points.shape[1]
        seen = rng.permutation(total)[: max(1, round(config.point_share * total))]
        points = rows.points[:, seen].astype(np.float32)
        signs = np.array([-1.0, 1.0], np.float32)
        sign, candidates = rng.choice(signs, (len(points), 1, 1)), rows.candidates.copy()
        points[..., self.mirrored] *= sign
        candidates[:, self.mirrored_candidates] *= sign[:, 0]
        noise = rng.standard_normal((*points.shape[:2], 3), np.float32)
        points[..., :3] += np.float32(config.jitter) * noise
        columns = points, rows.shared, candidates, rows.truth, rows.group
        return CriticBatch(*map(torch.from_numpy, columns))

    def loss(
        self, module: nn.Module, micro_batch: CriticBatch, generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return the loss of each candidate, the loss of choices, and their sum as `total`."""
        return batch_loss(module, micro_batch, generator, self.config.dropout, self.weight_choice)

    def tensors(self, micro_batch: CriticBatch) -> dict[str, Tensor]:
        """Return a micro-batch as named tensors."""
        return dict(vars(micro_batch))

    def validate(self) -> dict[str, float]:
        """Calibrate the module on the held-out candidates; return its figures on them.

        `loss`: cross-entropy of the calibrated log odds. `chosen`: mean truth of each group's most
        likely candidate; `best`: mean truth of each group's best candidate.
        """
        module = self.module
        if not isinstance(module, CriticModule):
            raise TypeError("a critic's module is expected")
        logits = self._held_logits(module.as_critic())
        truth, group = self.held.truth.astype(np.float64), self.held.group
        calibration = logistic_regression(logits[:, None], truth)
        module.get_buffer("calibration").copy_(torch.from_numpy(calibration))
        return {
            "loss": log_loss(calibration[0] + calibration[1] * logits, truth),
            "chosen": float(truth[best_of_groups(logits, group)].mean()),
            "best": float(truth[best_of_groups(truth, group)].mean()),
        }

    def _held_logits(self, critic: PointCritic) -> Array:
        """Return the logits (k,) of the held-out candidates."""
        parts = [self.held[start : start + CHUNK] for start in range(0, len(self.held), CHUNK)]
        found = [
            critic.fast_logits(part.points.astype(np.float32), part.shared, part.candidates)
            for part in parts
        ]
        return np.concatenate(found).astype(np.float64)


def choice_weight(kind: CriticKind, config: TrainCriticConfig) -> float:
    """Return the weight of the loss of choices; 0 to learn from each candidate alone."""
    return config.weight_choice if kind.chooses else 0.0


def replay(fault: Fault, kind: CriticKind) -> dict[str, float]:
    """Return the loss terms of a kept micro-batch."""
    settings = {name: each for name, each in fault.settings.items() if name != "kind"}
    config = from_settings(TrainCriticConfig, settings)
    count = len(kind.features.candidate)
    module = CriticModule(kind.features, torch.zeros(count), torch.ones(count))
    fill(module, fault.weights, fault.path)
    batch, weight = CriticBatch(**fault.batch), choice_weight(kind, config)
    terms = batch_loss(module, batch, fault.generator(), config.dropout, weight)
    return {name: float(term.detach()) for name, term in terms.items()}


def batch_loss(
    module: nn.Module,
    batch: CriticBatch,
    generator: torch.Generator,
    dropout: float,
    weight_choice: float,
) -> dict[str, Tensor]:
    """Return the terms of the loss of one micro-batch by name, `total` among them."""

    def dropped(hidden: Tensor) -> Tensor:
        """Return `hidden` with a share of its numbers dropped, as `functional.dropout` does."""
        kept = torch.rand(hidden.shape, generator=generator) >= dropout
        return hidden * kept / (1.0 - dropout)

    logits = module(batch, dropped)
    each = functional.binary_cross_entropy_with_logits(logits, batch.truth)
    if weight_choice == 0:
        return {"total": each}
    choice = choice_loss(logits, batch.truth, batch.group)
    return {"total": each + weight_choice * choice, "each": each, "choice": choice}


def choice_loss(logits: Tensor, truth: Tensor, group: Tensor) -> Tensor:
    """Return the mean over groups of the best `truth` (k,) less that of a random choice.

    The choice is drawn by the softmax of `logits` (k,) within each `group` (k,).
    """
    _, place, count = torch.unique(group, return_inverse=True, return_counts=True)

    def by_group(values: Tensor, how: str) -> Tensor:
        start = torch.zeros(len(count), dtype=values.dtype)
        return start.scatter_reduce(0, place, values, how, include_self=False)

    weight = torch.exp(logits - by_group(logits.detach(), "amax")[place])
    expected = by_group(weight * truth, "sum") / by_group(weight, "sum")
    return (by_group(truth, "amax") - expected).mean()
