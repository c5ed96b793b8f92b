"""Scenes rendered ahead by other processes equal those rendered here; faults are reported."""

import multiprocessing
import os
import signal
import struct
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import SymgraspError
from pipelines.synthesis.endless import EndlessScenes
from pipelines.synthesis.endless_pool import EndlessPool
from tests.stages.toy_root import STAMP, write_root
from tests.synthesis.test_endless import CONFIG

FEW = replace(CONFIG, scenes_together=2)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"))
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(made.root / "objects.json", records, STAMP)
    return made.root


def ask_to_end(pool, number):
    for process in list(pool._pool._processes):
        os.kill(process, number)


def test_regions_are_the_same_in_any_order_and_come_from_processes_asked_to_end(root):
    here = EndlessScenes.of_roots([root], FEW, 0)
    with EndlessPool([root], FEW, 0, 1) as pool:
        for scene, slot in ((1, 0), (0, 3), (2, 5), (3, 1), (5, 0)):
            ours, theirs = here.regions(scene)[slot], pool.region(scene, slot)
            np.testing.assert_array_equal(theirs.points, ours.points)
        assert min(pool._futures) >= 2  # earlier scenes are dropped
        ask_to_end(pool, signal.SIGTERM)
        assert 9 not in pool._futures  # rendered in this process from here on
        ours, theirs = here.regions(9)[0], pool.region(9, 0)
        np.testing.assert_array_equal(theirs.points, ours.points)
        ask_to_end(pool, signal.SIGKILL)
        pool._futures.clear()
        with pytest.raises(SymgraspError, match="continue by --resume"):
            pool.region(10, 0)


def test_a_missing_label_is_reported_to_the_process_that_requests_a_region(tmp_path):
    made = write_root(tmp_path)
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(made.root / "objects.json", records, STAMP)
    made.symmetry_path(1).unlink()
    with (
        EndlessPool([made.root], FEW, 0, 1) as pool,
        pytest.raises(SymgraspError, match=r"001\.json does not exist; .*annotate-symmetry"),
    ):
        pool.region(0, 0)


def write_half_a_result(marker):
    """Write the head of a result to the pool's pipe, and nothing after it."""
    frame = sys._getframe()
    while "result_queue" not in frame.f_locals:
        frame = frame.f_back
    os.write(frame.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 1000))
    marker.touch()
    time.sleep(3600.0)


def test_closing_the_pool_waits_neither_for_scenes_nor_for_the_rest_of_a_result(root, tmp_path):
    with EndlessPool([root], FEW, 0, 1) as pool:
        pool.region(0, 0)
        cut_off = pool._pool.submit(write_half_a_result, tmp_path / "half")
        waiting = pool._pool.submit(time.sleep, 3600.0)
        while not (tmp_path / "half").exists():
            time.sleep(0.05)
        (process,) = pool._pool._processes.values()
    assert not process.is_alive()
    assert cut_off.done()
    assert waiting.done()


def test_a_thread_that_loads_ahead_starts_no_process_after_the_end_of_the_pool(root):
    others = set(multiprocessing.active_children())
    with EndlessPool([root], FEW, 0, 1) as pool:
        pass
    with pytest.raises(SymgraspError, match="after the end of the training"):
        pool.region(0, 0)
    assert set(multiprocessing.active_children()) <= others
