"""Processes that train together under torchrun; without it, this process alone.

`torchrun --nproc-per-node 2 --no-python symgrasp train ...`: each process works on its share of
every batch, on its own GPU if there is one; only the first process writes files and messages.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta

import torch
from torch import Tensor, distributed

from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.network.devices import find_device
from pipelines.runtime.batch import BatchOptions

# The others wait while the first process validates or prepares frames.
LONGEST_WAIT = timedelta(days=7)


@dataclass(frozen=True)
class Processes:
    """This process among the processes of a training."""

    rank: int = 0  # number of this process; the first, 0, writes files and messages
    count: int = 1  # number of processes

    @property
    def is_first(self) -> bool:
        """Whether this is the process that writes files and messages."""
        return self.rank == 0

    def add_up(self, tensors: Sequence[Tensor]) -> None:
        """Replace each tensor by its sum over all processes; all have the same dtype."""
        if self.count == 1:
            return
        flat = torch.cat([tensor.flatten() for tensor in tensors])
        with _lost_peers():
            distributed.all_reduce(flat)
        parts = torch.split(flat, [tensor.numel() for tensor in tensors])
        for tensor, part in zip(tensors, parts, strict=True):
            tensor.copy_(part.view_as(tensor))

    def most(self, value: int) -> int:
        """Return the largest `value` of all processes."""
        if self.count == 1:
            return value
        shared = torch.tensor(value)
        with _lost_peers():
            distributed.all_reduce(shared, distributed.ReduceOp.MAX)
        return int(shared)

    def wait(self) -> None:
        """Return once all processes have called this."""
        self.most(0)

    @contextmanager
    def one_first(self, options: BatchOptions) -> Iterator[BatchOptions]:
        """Let the first process prepare data, then the others; only the first may overwrite any."""
        if not self.is_first:
            self.wait()
        yield replace(options, overwrite=options.overwrite and self.is_first)
        if self.is_first:
            self.wait()


@contextmanager
def process_group(device: str) -> Iterator[tuple[Processes, torch.device]]:
    """Yield the processes that torchrun started, and the device named `device` of this process.

    Raises:
        ValueRangeError: one GPU is named for several processes.
    """
    if not distributed.is_torchelastic_launched():
        yield Processes(), find_device(device)
        return
    # This module, which an optimizer's first step imports, keeps the group that exists at its
    # import. Threads of a kept group outlive the group and could abort the process at its end, so
    # the module is imported before there is a group.
    import torch.distributed.nn.functional  # noqa: PLC0415

    if ":" in device and int(os.environ["LOCAL_WORLD_SIZE"]) > 1:
        raise ValueRangeError("--device", device, "cuda, which gives each process its own GPU")
    found = find_device(device, int(os.environ["LOCAL_RANK"]))
    if found.type == "cuda":
        torch.cuda.set_device(found)
    backend = "cpu:gloo,cuda:nccl" if found.type == "cuda" else "gloo"
    distributed.init_process_group(backend, timeout=LONGEST_WAIT)
    try:
        yield Processes(distributed.get_rank(), distributed.get_world_size()), found
    finally:
        distributed.destroy_process_group()


@contextmanager
def _lost_peers() -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:
        raise SymgraspError(
            "another process of this training has ended; its message gives the reason"
        ) from error
