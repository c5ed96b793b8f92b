"""Gradients of a batch from its micro-batches, computed several at a time.

On a CPU two threads with a micro-batch each are faster than one operation spread over two cores:
most operations here are small. Each micro-batch runs on its own copy of the module, which shares
the parameters and owns its buffers (the running statistics of batch norm); gradients and buffers
are joined in the order of the micro-batches, so the number of threads changes no result.

Batch norm uses the statistics of each single micro-batch; its running statistics become the mean
of the running statistics after each micro-batch.
"""

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Self

import torch
from torch import Tensor, nn

from pipelines.learning.loop.trainee import MicroBatch, Trainee
from pipelines.learning.speed.micro_batches import PlannedMicroBatch, generator
from pipelines.learning.speed.processes import Processes

Gradients = list[Tensor]
Losses = dict[str, float]
Loaded = tuple[PlannedMicroBatch, MicroBatch]


@contextmanager
def intra_op_threads(count: int) -> Iterator[None]:
    """Let one operation use `count` cores at most inside the context."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def loss_seed(seed: int, epoch: int, step: int, number: int) -> int:
    """Return the seed of the random draws in the loss of one micro-batch."""
    return int(generator(seed, epoch, step, number, 1).integers(2**62))


class StepAbandoned(Exception):  # noqa: N818 - nothing went wrong
    """A step that was abandoned on request and has changed nothing."""


class GradientWorkers:
    """A pool of threads that compute gradients; for one thread no pool is started."""

    def __init__(
        self,
        trainee: Trainee,
        threads: int,
        processes: Processes | None = None,
        is_stopped: Callable[[], bool] | None = None,
    ) -> None:
        self._is_stopped = is_stopped or (lambda: False)
        self.trainee, self.processes = trainee, processes or Processes()
        self.parameters = [p for p in trainee.module.parameters() if p.requires_grad]
        self._copies: list[nn.Module] = []
        self._buffers: list[tuple[Tensor, Tensor]] = []
        self._pool = (
            ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
            if threads > 1
            else None
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def gradients(
        self, loaded: Sequence[Loaded], place: tuple[int, ...]
    ) -> tuple[Losses, Gradients]:
        """Return loss terms and gradients, both summed over micro-batches by their shares.

        The sums are over all processes. `place` (seed, epoch, step) seeds the random draws of each
        micro-batch's loss.

        Raises:
            StepAbandoned: the training is to stop, and not all micro-batches are done.
        """
        copies = self._fresh_copies(len(loaded))

        def work(number: int) -> tuple[Losses, Gradients]:
            if self._is_stopped():
                raise StepAbandoned
            return self._work(copies[number], loaded[number], place)

        numbers = range(len(loaded))
        results = list(map(work, numbers) if self._pool is None else self._pool.map(work, numbers))
        losses, total = results[0]
        for more_losses, more in results[1:]:
            losses = {name: value + more_losses[name] for name, value in losses.items()}
            for each, added in zip(total, more, strict=True):
                each.add_(added)
        self._buffers = self._mean_buffers(copies, [planned.share for planned, _ in loaded])
        self.processes.add_up([*total, *(mean for _, mean in self._buffers)])
        terms = torch.tensor(list(losses.values()), dtype=torch.float64)
        self.processes.add_up([terms])
        return dict(zip(losses, terms.tolist(), strict=True)), total

    def find_fault(self, loaded: Sequence[Loaded], place: tuple[int, ...]) -> Loaded | None:
        """Return the first micro-batch without finite loss and gradient; None if all are finite."""
        for each in loaded:
            (module,) = self._fresh_copies(1)
            losses, gradients = self._work(module, each, place)
            finite = all(bool(gradient.isfinite().all()) for gradient in gradients)
            if not finite or not all(math.isfinite(value) for value in losses.values()):
                return each
        return None

    def _work(
        self, module: nn.Module, loaded: Loaded, place: tuple[int, ...]
    ) -> tuple[Losses, Gradients]:
        (planned, micro_batch), (seed, epoch, step) = loaded, place
        drawing = torch.Generator().manual_seed(loss_seed(seed, epoch, step, planned.number))
        terms = self.trainee.loss(module, micro_batch, drawing)
        total = terms["total"] * planned.share
        gradients = torch.autograd.grad(total, self.parameters, allow_unused=True)
        filled = [
            torch.zeros_like(parameter) if gradient is None else gradient
            for gradient, parameter in zip(gradients, self.parameters, strict=True)
        ]
        values = torch.stack([term.detach().double() for term in terms.values()]) * planned.share
        return dict(zip(terms, values.tolist(), strict=True)), filled

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
    def _mean_buffers(
        self, copies: Sequence[nn.Module], shares: Sequence[float]
    ) -> list[tuple[Tensor, Tensor]]:
        """Return the module's buffers with the mean of the copies; integers are the first's."""
        pairs = []
        for own, *theirs in zip(
            self.trainee.module.buffers(), *(each.buffers() for each in copies), strict=True
        ):
            if own.is_floating_point():
                weighted = [value * share for value, share in zip(theirs, shares, strict=True)]
                pairs.append((own, torch.stack(weighted).sum(0)))
            else:
                own.copy_(theirs[0])
        return pairs

    @torch.no_grad()
    def adopt_buffers(self) -> None:
        """Give the module the buffers that resulted from the last batch."""
        for own, mean in self._buffers:
            own.copy_(mean)
