"""Gradients of a batch from its micro-batches, several worked on at a time.

On a CPU two threads with a micro-batch each are faster than one operation spread over two cores:
most operations here are small. Each micro-batch runs on its own copy of the module, which shares
the parameters and owns its buffers (the running statistics of batch norm); gradients and buffers
are put together in the order of the micro-batches, so the number of threads changes no result.
"""

import copy
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor, nn

from pipelines.learning.trainee import Trainee

Gradients = list[Tensor]


@contextmanager
def intra_op_threads(count: int) -> Iterator[None]:
    """Let one operation use `count` cores at most for as long as the context lasts."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class GradientWorkers:
    """A pool of threads that compute gradients; with one thread, none is started."""

    def __init__(self, trainee: Trainee, threads: int) -> None:
        self.trainee = trainee
        self.parameters = [p for p in trainee.module.parameters() if p.requires_grad]
        self._copies: list[nn.Module] = []
        self._pool = (
            ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
            if threads > 1
            else None
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def gradients(
        self, micro_batches: Sequence[tuple[float, Any]], key: tuple[int, ...]
    ) -> tuple[dict[str, float], Gradients]:
        """Return loss terms and gradients, both summed over micro-batches by their shares.

        `key` (seed, epoch, step) decides what each micro-batch's loss draws at random.
        """
        copies = self._fresh_copies(len(micro_batches))

        def work(number: int) -> tuple[dict[str, float], Gradients]:
            return self._work(copies[number], *micro_batches[number], (*key, number))

        numbers = range(len(micro_batches))
        results = list(map(work, numbers) if self._pool is None else self._pool.map(work, numbers))
        self._merge_buffers(copies)
        losses, total = results[0]
        for more_losses, more in results[1:]:
            losses = {name: value + more_losses[name] for name, value in losses.items()}
            torch._foreach_add_(total, more)
        return losses, total

    def _work(
        self,
        module: nn.Module,
        share: float,
        micro_batch: Any,  # noqa: ANN401 - the trainee's own
        key: tuple[int, ...],
    ) -> tuple[dict[str, float], Gradients]:
        seed = int(np.random.SeedSequence(key).generate_state(1, np.uint64)[0] >> np.uint64(1))
        generator = torch.Generator().manual_seed(seed)
        terms = self.trainee.loss(module, micro_batch, generator)
        gradients = torch.autograd.grad(terms["total"] * share, self.parameters, allow_unused=True)
        filled = [
            torch.zeros_like(parameter) if gradient is None else gradient
            for gradient, parameter in zip(gradients, self.parameters, strict=True)
        ]
        return {name: float(term.detach()) * share for name, term in terms.items()}, filled

    @torch.no_grad()
    def _fresh_copies(self, count: int) -> list[nn.Module]:
        """Return copies of the module that share its parameters and have its buffers' values."""
        module = self.trainee.module
        shared = {id(parameter): parameter for parameter in module.parameters()}
        while len(self._copies) < count:
            self._copies.append(copy.deepcopy(module, dict(shared)))
        copies = self._copies[:count]
        for each in copies:
            each.train()
            for own, source in zip(each.buffers(), module.buffers(), strict=True):
                own.copy_(source)
        return copies

    @torch.no_grad()
    def _merge_buffers(self, copies: Sequence[nn.Module]) -> None:
        """Give the module the mean of its copies' floating-point buffers; others of the first."""
        for own, *theirs in zip(
            self.trainee.module.buffers(), *(each.buffers() for each in copies), strict=True
        ):
            mean = torch.stack(theirs).mean(0) if own.is_floating_point() else theirs[0]
            own.copy_(mean)
