"""Hungarian assignment of the true planes to reflection slots (Sec. III-E)."""

from dataclasses import replace

import torch
from torch import Tensor

from pipelines.network.training.dense_error import reflection_errors
from pipelines.network.training.region_batch import RegionBatch

NUM_REFLECTIONS = 3
MAX_MATCHED = 96  # approximate number of points that vote on the assignment; chosen by eye
MOST = 1e12  # stands for infinite costs; three of them can be added in single precision


@torch.no_grad()
def match_reflections(
    truth: RegionBatch,
    points: Tensor,  # (B, S, 3)
    normal: Tensor,  # (B, Q, 3, 3)
    center: Tensor,  # (B, Q, 3, 3)
    weight: Tensor,  # (B, Q)
) -> RegionBatch:
    """Return `truth` with its planes in the slots that predict them best.

    The cost of a plane in a slot is the dense error of the slot's predictions, averaged over (some
    of) the Q points by `weight` (B, Q). Labels may list planes in any order.
    """
    stride = max(1, normal.shape[1] // MAX_MATCHED)
    normal, center, weight = normal[:, ::stride], center[:, ::stride], weight[:, ::stride]
    planes = range(NUM_REFLECTIONS)
    errors = [
        reflection_errors(points, normal[:, :, slot], center[:, :, slot], *true)
        for slot in planes
        for true in ((truth.direction[:, plane], truth.center[:, plane]) for plane in planes)
    ]
    costs = torch.stack([(error * weight).sum(-1) for error in errors], -1)
    cost = costs.view(-1, NUM_REFLECTIONS, NUM_REFLECTIONS)  # (B, slot, plane)
    existing = truth.existence[:, None, :NUM_REFLECTIONS] > 0
    # An absent plane has equal costs everywhere, so it takes a slot that the others leave.
    order = assign(torch.where(existing, cost, 0.0))
    others = torch.arange(NUM_REFLECTIONS, NUM_REFLECTIONS + 2, device=order.device)
    picked = torch.cat([order, others.expand(len(order), 2)], 1)
    rows = picked[..., None].expand(-1, -1, 3)
    return replace(
        truth,
        existence=truth.existence.gather(1, picked),
        center=truth.center.gather(1, rows),
        direction=truth.direction.gather(1, rows),
    )


def assign(cost: Tensor) -> Tensor:
    """Return the plane (B, slot) of each slot that minimises the sum of `cost` (B, slot, plane).

    All six assignments are compared on the device of the costs, so that a GPU need not wait for the
    host. Costs that are not finite do not fail here: the loss is then not finite either, which the
    training reports.
    """
    finite = torch.nan_to_num(cost, nan=MOST, posinf=MOST, neginf=-MOST)
    orders = _assignments(cost.device)
    sums = finite[:, torch.arange(NUM_REFLECTIONS, device=cost.device), orders].sum(-1)  # (B, 6)
    return orders[sums.argmin(-1)]


def _assignments(device: torch.device) -> Tensor:
    """Return all (6, slot) assignments of planes to slots, on `device`."""
    number = torch.arange(6, device=device)
    first = number // 2
    lower, upper = (first == 0).long(), 2 - (first == 2).long()  # the remaining planes
    second = torch.where(number % 2 == 0, lower, upper)
    return torch.stack([first, second, lower + upper - second], 1)
