"""Batches of packed regions, drawn by seed and step, and loading ahead."""

import queue
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from pipelines.array_types import Indices, Singles
from pipelines.configs import NetworkConfig
from pipelines.dataset.training.packed_regions import (
    PackedReader,
    PackedRegion,
    scene_of,
    scenes_with_regions,
)
from pipelines.errors import ValueRangeError
from pipelines.network.training.region_batch import RegionBatch
from pipelines.tabletop.levelling import level_axes, table_of_row

STOP_SECONDS = 0.5  # between checks whether to stop

Item = TypeVar("Item")
Result = TypeVar("Result")


def epoch_batches(
    indices: Sequence[int] | Indices, batch_size: int, rng: np.random.Generator
) -> list[Indices]:
    """Return `indices` in random order, cut into batches; a rest is left out of the epoch.

    Fewer indices than a batch are one batch; no indices are no batch.
    """
    order = rng.permutation(np.asarray(indices, np.int64))
    count = max(min(1, len(order)), len(order) // batch_size)
    return [order[i * batch_size : (i + 1) * batch_size] for i in range(count)]


def split_by_scene(
    reader: PackedReader, fraction: float, rng: np.random.Generator
) -> tuple[Indices, Indices]:
    """Return indices of training regions and of the regions of the `fraction` of scenes held out.

    Files of one scene (its two cameras) stay together: a view of a training scene is no
    test on an unseen scene. At least one scene is held out and one is trained on; scenes without
    regions do not count.

    Raises:
        ValueRangeError: fewer than two scenes hold regions.
    """
    scenes = scenes_with_regions(reader.paths, reader.counts)
    if len(scenes) < 2:
        expected = "at least 2, or give --val a folder of packed regions"
        raise ValueRangeError("number of packed scenes with regions", len(scenes), expected)
    count = min(max(1, round(fraction * len(scenes))), len(scenes) - 1)
    held_out = set(rng.permutation(scenes)[:count].tolist())
    is_held_out = np.repeat([scene_of(path) in held_out for path in reader.paths], reader.counts)
    return np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)


def load_regions(
    reader: PackedReader,
    indices: Indices,
    network: NetworkConfig,
    generators: Sequence[np.random.Generator],
) -> RegionBatch:
    """Return regions of `num_points` points each, centred on the centroid of these points.

    Each region draws its points from its own generator.
    """
    pairs = zip(indices, generators, strict=True)
    return batch_of([draw_points(reader[int(i)], network, rng) for i, rng in pairs])


def batch_of(regions: Sequence[tuple[Singles, ...]]) -> RegionBatch:
    """Return regions of `draw_points` as one batch."""
    return RegionBatch(*(torch.from_numpy(np.stack(each)) for each in zip(*regions, strict=True)))


def draw_points(
    region: PackedRegion, network: NetworkConfig, rng: np.random.Generator, lost_table: float = 0.0
) -> tuple[Singles, ...]:
    """Return some of a region's points, centred, in the network's axes, and their labels.

    The points are in random order, which `SetAbstraction` assumes.
    `lost_table`: probability that the table is treated as unknown.
    """
    available, count = len(region.points), network.num_points
    chosen = rng.permutation(available)[:count]
    if available < count:
        chosen = np.concatenate([chosen, rng.integers(available, size=count - available)])
    points = region.points[chosen]
    centroid = points.mean(0)
    axes, ground = np.eye(3, dtype=np.float32), np.zeros((), np.float32)
    if network.input_frame == "table":
        table = table_of_row(region.table) if rng.random() >= lost_table else None
        axes = level_axes(centroid, table).astype(np.float32)
        ground = table.height(centroid).astype(np.float32) if table else ground
    center: Singles = np.nan_to_num(region.point - centroid) @ axes.T
    direction: Singles = np.nan_to_num(region.direction) @ axes.T
    labels = region.affordance[chosen], region.existence, center, direction
    return (points - centroid) @ axes.T, *labels, ground, -axes @ centroid


class _Steps(Dataset[Result | Exception]):
    """The loaded batch of each step, or the error in loading, for torch's loader."""

    def __init__(self, load: Callable[[int], Result]) -> None:
        self.load = load

    def __getitem__(self, step: int) -> Result | Exception:
        try:
            return self.load(step)
        except Exception as error:  # torch's loader would raise it as another class
            return error


def load_ahead(
    load: Callable[[int], Result],
    steps: range,
    processes: int = 0,
    is_stopped: Callable[[], bool] = lambda: False,
) -> Generator[Result]:
    """Yield `load(step)` for each step, in order, loaded ahead.

    `processes` forked processes load, or a thread if it is 0; the batches are equal either way.
    Ends early if `is_stopped` becomes true while a batch of the thread is awaited.
    """
    if not processes or not len(steps):
        yield from prefetch(load, steps, is_stopped=is_stopped)
        return
    loader = DataLoader(
        _Steps(load),
        batch_size=None,
        sampler=steps,
        num_workers=min(processes, len(steps)),
        collate_fn=lambda batch: batch,
        multiprocessing_context="fork",
    )
    for loaded in loader:
        if isinstance(loaded, Exception):
            raise loaded
        yield loaded


def _waited_for(
    ready: "queue.Queue[Result | BaseException | None]", is_stopped: Callable[[], bool]
) -> Result | BaseException | None:
    """Return the next item of `ready`, or None once `is_stopped` is true."""
    while True:
        try:
            return ready.get(timeout=STOP_SECONDS)
        except queue.Empty:
            if is_stopped():
                return None


def prefetch(
    load: Callable[[Item], Result],
    items: Iterable[Item],
    is_stopped: Callable[[], bool] = lambda: False,
) -> Iterator[Result]:
    """Yield `load(item)` for each item, two items loaded ahead in a thread.

    An exception of `load` is raised in place of the result. Ends early if `is_stopped` becomes true
    while a result is awaited.
    """
    ready: queue.Queue[Result | BaseException | None] = queue.Queue(2)
    stopped = threading.Event()

    def work() -> None:
        try:
            for item in items:
                if stopped.is_set():
                    return
                ready.put(load(item))
            ready.put(None)
        except BaseException as error:
            ready.put(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while (result := _waited_for(ready, is_stopped)) is not None:
            if isinstance(result, BaseException):
                raise result
            yield result
    finally:
        stopped.set()
        # The thread may wait for room in the queue; a stopped training does not wait for it.
        while thread.is_alive() and not is_stopped():
            while not ready.empty():
                ready.get_nowait()
            thread.join(0.01)
