"""Worker processes that render scenes ahead of a training."""

import os
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Self

import cv2

from pipelines.configs import EndlessConfig
from pipelines.dataset.training.packed_regions import PackedRegion
from pipelines.ending import begin_worker, signals_put_off
from pipelines.errors import SymgraspError
from pipelines.synthesis.endless import EndlessScenes

GRACE = 20.0  # seconds for the training to end its step and write its checkpoint

# Scenes of a worker process, or the error that prevents them.
_OWN: list[EndlessScenes | SymgraspError] = []


class EndlessPool:
    """Regions of scenes by number, rendered ahead in groups of `scenes_together` scenes.

    The current and the next group are kept: scenes may be requested in any order within a group,
    groups in ascending order. A scene does not depend on the process that renders the scene.
    """

    def __init__(
        self, roots: Sequence[Path], config: EndlessConfig, seed: int, workers: int
    ) -> None:
        self.together = config.scenes_together
        self._futures: dict[int, Future[list[PackedRegion]]] = {}
        # A thread that loads ahead may start a process while the pool ends, which nobody would end.
        self._beginning = threading.Lock()
        self._is_ended = False
        # A forked process may wait forever for a lock that a thread of its parent holds.
        self._pool = ProcessPoolExecutor(
            workers,
            mp_context=get_context("spawn"),
            initializer=_start,
            initargs=(roots, config, seed, os.getpid()),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        # Nobody reads the scenes still being rendered; without an end, the exit waits for them.
        with self._beginning:
            self._is_ended = True
        for process in list((getattr(self._pool, "_processes", None) or {}).values()):
            process.kill()
        # A process may have written half a result; the reader waits while the pipe has a writer.
        if results := getattr(self._pool, "_result_queue", None):
            results._writer.close()
        self._pool.shutdown(cancel_futures=True)

    def region(self, scene: int, slot: int) -> PackedRegion:
        """Return region `slot` of scene number `scene`.

        Raises:
            SymgraspError: a label is missing or faulty, or a process or the pool has ended.
        """
        group = scene // self.together
        try:
            with self._beginning:
                self._begin(range(group * self.together, (group + 2) * self.together))
            for number in [each for each in self._futures if each < (group - 1) * self.together]:
                del self._futures[number]
            return self._futures[scene].result()[slot]
        except BrokenProcessPool as error:
            raise SymgraspError(
                "a process that renders regions has ended, perhaps for lack of memory; "
                "continue by --resume with fewer --workers"
            ) from error

    def _begin(self, numbers: range) -> None:
        """Start rendering the scenes `numbers`, unless it has started."""
        if self._is_ended:
            raise SymgraspError("no scene is rendered after the end of the training")
        for number in numbers:
            if number not in self._futures:
                with signals_put_off():
                    self._futures[number] = self._pool.submit(_regions, number)


def _start(roots: Sequence[Path], config: EndlessConfig, seed: int, parent: int) -> None:
    begin_worker(parent)  # the training handles Ctrl-C
    signal.signal(signal.SIGTERM, _end_soon)  # torchrun signals all; the step needs its scenes
    cv2.setNumThreads(1)
    try:
        _OWN.append(EndlessScenes.of_roots(roots, config, seed))
    except SymgraspError as error:  # raised when a scene is requested
        _OWN.append(error)


def _end_soon(_number: int, _frame: object) -> None:
    ending = threading.Timer(GRACE, os._exit, (1,))
    ending.daemon = True
    ending.start()


def _regions(scene: int) -> list[PackedRegion]:
    scenes = _OWN[0]
    if isinstance(scenes, SymgraspError):
        raise scenes
    return scenes.regions(scene)
