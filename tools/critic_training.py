"""Training of a `PointCritic` on collected rows, for planes and grasps alike.

Rows are arrays of as many rows as candidates: `points` (k, n, p), `wholes` (k, w), `evidence`
(k, e), `truth` (k,) 0 to 1, below 0 where it is not known, and in files `group` (k,): candidates
of one group are those that one choice is made from.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from calibrate_trust import logistic
from torch import Tensor, nn
from torch.nn import functional

from pipelines.grasping.ranking.point_critic import PointCritic
from pipelines.storage.checkpoints import save_weights
from pipelines.storage.files import atomic_path

POINT_WIDTHS, LAST_WIDTHS = (64, 64, 96), (64, 32, 1)
BATCH, DECAY, DROPOUT = 256, 1e-2, 0.2
LEAST_SPREAD = 1e-2  # of evidence that hardly varied: what does later must not outweigh the rest

Rows = dict[str, np.ndarray]


@dataclass(frozen=True)
class Training:
    """How a critic of one kind is trained.

    Attributes:
        mirrored: columns of points whose sign means nothing, all at once.
        points_a_step: of all: another view of the same candidate each time.
        jitter: of a point's place, in its own unit.
        rate: of learning, the highest.
        epochs: passes over the rows.
        choice: weight of what choosing by the logits loses of a group's best; 0 to learn of
            each candidate alone.
    """

    mirrored: tuple[int, ...]
    points_a_step: int
    jitter: float
    rate: float
    epochs: int = 12
    choice: float = 0.0

    def varied(self, points: Tensor) -> Tensor:
        """Return some of the points, jittered, in either handedness."""
        chosen = points[:, torch.randperm(points.shape[1])[: self.points_a_step]]
        sign = torch.where(torch.rand(len(points), 1) < 0.5, -1.0, 1.0)
        for column in self.mirrored:
            chosen[..., column] *= sign
        chosen[..., :3] += self.jitter * torch.randn_like(chosen[..., :3])
        return chosen


class TrainedCritic(nn.Module):
    """`PointCritic` with gradients: `features` of a point, `shared` by all of a candidate's."""

    def __init__(self, features: int, shared: int, mean: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.point = layers(features + shared, POINT_WIDTHS)
        self.last = layers(2 * POINT_WIDTHS[-1] + len(mean) + shared, LAST_WIDTHS)
        self.register_buffer("mean", mean)
        self.register_buffer("spread", spread)

    def forward(self, points: Tensor, wholes: Tensor, evidence: Tensor) -> Tensor:
        """Return logits (k,) of points (k, n, features), wholes (k, shared), evidence (k, e)."""
        around = wholes[:, None].expand(-1, points.shape[1], -1)
        hidden = torch.cat([points, around], -1)
        for index, layer in enumerate(self.point):
            hidden = layer(torch.relu(hidden) if index else hidden)
        known = (evidence - self.mean) / self.spread
        joined = torch.cat([hidden.amax(1), hidden.mean(1), known, wholes], -1)
        for index, layer in enumerate(self.last):
            joined = layer(torch.relu(joined) if index else joined)
            if index == 0:
                joined = functional.dropout(joined, DROPOUT, self.training)
        return joined[:, 0]


def layers(width: int, widths: tuple[int, ...]) -> nn.ModuleList:
    """Return linear layers from `width` through `widths`."""
    sizes = zip((width, *widths), widths, strict=False)
    return nn.ModuleList(nn.Linear(*size) for size in sizes)


def write(path: Path, regions: Iterable[Rows]) -> int:
    """Write the rows of all `regions`; return how many there are."""
    parts = list(regions)
    rows = {name: np.concatenate([each[name] for each in parts]) for name in parts[0]}
    rows["group"] = np.repeat(np.arange(len(parts)), [len(each["truth"]) for each in parts])
    rows["points"] = rows["points"].astype(np.float16)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **rows)
    return len(rows["truth"])


def read(paths: Iterable[Path]) -> Rows:
    """Return the rows of all files whose truth is known."""
    parts, groups = [], 0
    for path in paths:
        with np.load(path, allow_pickle=False) as arrays:
            names = ("points", "wholes", "evidence", "truth", "group")
            rows = {name: arrays[name] for name in names}
        rows["group"] += groups
        groups = rows["group"].max(initial=groups) + 1
        known = rows["truth"] >= 0
        parts.append({name: array[known] for name, array in rows.items()})
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def batches(group: np.ndarray, whole: bool, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the rows of each step of a pass: any, or `whole` groups until they are enough."""
    if not whole:
        order = rng.permutation(len(group))
        starts = range(0, len(group) - BATCH + 1, BATCH)
        return [np.sort(order[start : start + BATCH]) for start in starts]
    order = np.argsort(group, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    found, size = [[]], 0
    for index in rng.permutation(len(members)):
        if size >= BATCH:
            found.append([])
            size = 0
        found[-1].append(members[index])
        size += len(members[index])
    return [np.concatenate(batch) for batch in found]


def choice_loss(logits: Tensor, truth: Tensor, group: Tensor) -> Tensor:
    """Return how far below its group's best `truth` (k,) a choice by odds of `logits` (k,) is."""
    _, place, count = torch.unique(group, return_inverse=True, return_counts=True)

    def by_group(values: Tensor, how: str) -> Tensor:
        start = torch.zeros(len(count), dtype=values.dtype)
        return start.scatter_reduce(0, place, values, how, include_self=False)

    weight = torch.exp(logits - by_group(logits.detach(), "amax")[place])
    expected = by_group(weight * truth, "sum") / by_group(weight, "sum")
    return (by_group(truth, "amax") - expected).mean()


def trained(rows: Rows, training: Training, seed: int) -> TrainedCritic:
    """Return the network after all passes over `rows`."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    evidence = torch.from_numpy(rows["evidence"])
    features, shared = rows["points"].shape[-1], rows["wholes"].shape[-1]
    spread = evidence.std(0).clamp(min=LEAST_SPREAD)
    critic = TrainedCritic(features, shared, evidence.mean(0), spread)
    optimizer = torch.optim.AdamW(critic.parameters(), training.rate, weight_decay=DECAY)
    passes = [batches(rows["group"], training.choice > 0, rng) for _ in range(training.epochs)]
    rate = torch.optim.lr_scheduler.OneCycleLR(optimizer, training.rate, sum(map(len, passes)))
    for epoch, steps in enumerate(passes):
        losses = []
        for chosen in steps:
            loss = step_loss(critic, rows, chosen, training)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            rate.step()
            losses.append(float(loss.detach()))
        sys.stdout.write(f"epoch {epoch + 1}: loss {np.mean(losses):.4f}\n")
    return critic.eval()


def step_loss(critic: TrainedCritic, rows: Rows, chosen: np.ndarray, training: Training) -> Tensor:
    """Return the loss of the rows `chosen`."""
    points = torch.from_numpy(rows["points"][chosen].astype(np.float32))
    wholes, evidence = (torch.from_numpy(rows[name][chosen]) for name in ("wholes", "evidence"))
    truth = torch.from_numpy(rows["truth"][chosen]).float()
    logits = critic(training.varied(points), wholes, evidence)
    loss = functional.binary_cross_entropy_with_logits(logits, truth)
    if training.choice > 0:
        group = torch.from_numpy(rows["group"][chosen])
        loss = loss + training.choice * choice_loss(logits, truth, group)
    return loss


def fit(output: Path, model: str, held: Path, evidence: list[Path], training: Training) -> None:
    """Train on `evidence`, make log odds of what comes out by `held`, write all of it."""
    critic, other = trained(read(evidence), training, 0), read([held])
    arrays = {name: tensor.numpy() for name, tensor in critic.state_dict().items()}
    plain = PointCritic.of(arrays | {"calibration": np.float32([0.0, 1.0])})
    logits = plain.logits(other["points"].astype(np.float32), other["wholes"], other["evidence"])
    truth = other["truth"].astype(np.float64)
    weights = logistic(np.stack([np.ones(len(logits)), logits], 1), truth)
    loss = np.mean(np.logaddexp(0.0, logits) - truth * logits)
    sys.stdout.write(f"held out: {len(logits)} candidates, loss {loss:.4f}, {weights.round(2)}\n")
    arrays["calibration"] = weights.astype(np.float32)
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    save_weights(output, tensors, {"model": model})
