"""Processes that render labelled regions endlessly, and a buffer of regions on the GPU."""

import queue
from collections.abc import Sequence
from multiprocessing import get_context
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.configs import TrainConfig
from pipelines.dataset.training.packed_regions import PackedRegion
from pipelines.errors import SymgraspError
from pipelines.network.training.region_batch import RegionBatch
from pipelines.tabletop.levelling import level_axes, table_of_row
from tools.gpu_training.labelled_objects import scenes_of_file

Rows = tuple[NDArray[np.float32], ...]  # regions of a scene, one array for each of `SHAPES`
POINTS = 2048  # points of a rendered region
MOST_EMPTY = 20  # scenes without a region, one after the other, that a process tries
# Shapes of a region's arrays: points about their centroid, affordance, existence, centres,
# directions; the network's axes and the centroid's height, each with and without a table; the
# camera's place relative to the centroid.
SHAPES = ((POINTS, 3), (POINTS,), (5,), (5, 3), (5, 3), (2, 3, 3), (2,), (3,))


class Renderers:
    """Processes that render the first `limit` objects of a file, scene by scene.

    A process that cannot go on ends the training: `waiting` raises its error.
    """

    def __init__(self, objects: Path, seed: int, workers: int, limit: int | None = None) -> None:
        context = get_context("spawn")
        self.queue, self._stop = context.Queue(64), context.Event()
        arguments = objects, seed, limit, self.queue, self._stop
        self._workers = [
            context.Process(target=_render, args=(first, workers, *arguments), daemon=True)
            for first in range(workers)
        ]
        for worker in self._workers:
            worker.start()

    def waiting(self) -> Rows | None:
        """Return the regions of a waiting scene; None if no scene waits.

        Raises:
            SymgraspError: a process has failed, or all have ended.
        """
        # Before the look into the queue, which has all of an ended process.
        is_rendering = any(worker.is_alive() for worker in self._workers)
        try:
            found: Rows | SymgraspError = self.queue.get_nowait()
        except queue.Empty:
            if is_rendering:
                return None
            ended = "all processes that render regions have ended, perhaps for lack of memory"
            raise SymgraspError(f"{ended}; give fewer --workers") from None
        if isinstance(found, SymgraspError):
            raise found
        return found

    def end(self) -> None:
        """End the processes."""
        self._stop.set()
        for worker in self._workers:
            worker.terminate()


def _render(
    first: int, step: int, objects: Path, seed: int, limit: int | None, out: Queue, stop: Event
) -> None:
    cv2.setNumThreads(1)
    number, empty = first, 0
    try:
        scenes = scenes_of_file(objects, seed, limit)
        while not stop.is_set():
            try:
                regions, empty = scenes.regions(number), 0
            except SymgraspError:  # no region of this scene is visible
                regions, empty = [], empty + 1
                if empty == MOST_EMPTY:
                    raise
            if regions:
                rows = zip(*(_rows(region) for region in regions), strict=True)
                out.put(tuple(np.stack(each).astype(np.float32) for each in rows))
            number += step
    except SymgraspError as error:
        out.put(error)


def _rows(region: PackedRegion) -> tuple[np.ndarray, ...]:
    center = region.points.mean(axis=0)
    table = table_of_row(region.table)
    axes = np.stack([level_axes(center, table), level_axes(center, None)])
    height = np.array([table.height(center) if table else 0.0, 0.0])
    point, direction = np.nan_to_num(region.point - center), np.nan_to_num(region.direction)
    points = region.points - center
    labels = region.affordance, region.existence, point, direction
    return points, *labels, axes, height, -center


class RegionRing:
    """The newest `capacity` rendered regions, on a device."""

    def __init__(self, capacity: int, device: torch.device) -> None:
        self.columns = [torch.zeros((capacity, *shape), device=device) for shape in SHAPES]
        self.capacity, self.seen = capacity, 0

    def __len__(self) -> int:
        return min(self.seen, self.capacity)

    def add(self, rows: Sequence[np.ndarray]) -> None:
        """Add regions; if there is no room they replace the oldest regions."""
        count, start = len(rows[0]), self.seen % self.capacity
        fits = min(count, self.capacity - start)
        for column, array in zip(self.columns, rows, strict=True):
            values = torch.from_numpy(array)
            column[start : start + fits].copy_(values[:fits])
            column[: count - fits].copy_(values[fits:])
        self.seen += count

    def take_in(self, renderers: Renderers, scenes: int) -> None:
        """Add the regions of at most `scenes` waiting scenes."""
        for _ in range(scenes):
            rows = renderers.waiting()
            if rows is None:
                return
            self.add(rows)

    def batch(self, rows: Tensor, config: TrainConfig, lost_table: float) -> RegionBatch:
        """Return the regions `rows` (B,) as `draw_points` of `symgrasp train` makes them."""
        device, count = rows.device, len(rows)
        points, affordance, existence, center, direction, axes, height, camera = (
            column[rows] for column in self.columns
        )
        lost = (torch.rand(count, device=device) < lost_table).long()
        each = torch.arange(count, device=device)
        axes, height = axes[each, lost], height[each, lost]
        if config.network.input_frame == "camera":
            axes, height = torch.eye(3, device=device).expand_as(axes), torch.zeros_like(height)
        order = torch.rand((count, POINTS), device=device).argsort(1)
        order = order[:, : config.network.num_points]
        points = points.gather(1, order[..., None].expand(-1, -1, 3))
        middle = points.mean(1, keepdim=True)
        lift = torch.einsum("bi,bi->b", axes[:, 2], middle[:, 0])
        turned = axes.transpose(1, 2)
        return RegionBatch(
            (points - middle) @ turned,
            affordance.gather(1, order),
            existence,
            (center - middle) @ turned,
            direction @ turned,
            torch.where(height != 0, height + lift, height),
            ((camera[:, None] - middle) @ turned)[:, 0],
        )
