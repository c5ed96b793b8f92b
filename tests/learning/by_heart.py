"""Trainings that overfit a network to a few examples."""

from collections.abc import Callable

import torch


def learned(
    network: torch.nn.Module,
    loss: Callable[[], torch.Tensor],
    *,
    share: float,
    rate: float,
    most_steps: int,
) -> bool:
    """Return whether `loss` falls below `share` of its first value within `most_steps` steps."""
    optimizer = torch.optim.Adam(network.parameters(), lr=rate)
    first = float("inf")
    for step in range(most_steps):
        total = loss()
        first = float(total.detach()) if step == 0 else first
        if float(total.detach()) < share * first:
            return True
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
    return False
