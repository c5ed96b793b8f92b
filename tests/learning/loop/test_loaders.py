"""Batches: their items, their sources, and the handling of faults."""

import dataclasses
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from pipelines.configs import NetworkConfig
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.errors import ValueRangeError
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.learning.loop.loaders import (
    draw_points,
    epoch_batches,
    load_ahead,
    load_regions,
    prefetch,
    split_by_scene,
)
from pipelines.tabletop.levelling import level_axes, table_row
from tests.learning.packed_toys import write_packed


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    return PackedReader(write_packed(tmp_path_factory.mktemp("packed")))


def test_an_epoch_shows_each_region_at_most_once_in_full_batches():
    batches = epoch_batches(range(20), 6, np.random.default_rng(0))
    assert [len(batch) for batch in batches] == [6, 6, 6]
    assert len(set(np.concatenate(batches).tolist())) == 18


def test_fewer_regions_than_a_batch_are_one_batch():
    assert [len(b) for b in epoch_batches(range(4), 6, np.random.default_rng(0))] == [4]


def test_scenes_are_either_trained_on_or_held_out(reader):
    train, val = split_by_scene(reader, 0.3, np.random.default_rng(0))
    scenes = [{reader.locate(int(i))[0] for i in part} for part in (train, val)]
    assert scenes[0].isdisjoint(scenes[1])
    assert len(train) + len(val) == len(reader)
    assert len(scenes[1]) == 1


def test_the_files_of_a_scenes_two_cameras_are_on_one_side():
    cameras = ("kinect", "realsense")
    paths = [Path(f"scene_{n:04d}_{camera}.h5") for n in range(12) for camera in cameras]
    both = SimpleNamespace(paths=paths, counts=[3] * len(paths))
    for seed in range(10):
        train, val = split_by_scene(both, 0.3, np.random.default_rng(seed))
        sides = [{paths[i // 3].stem[:10] for i in part} for part in (train, val)]
        assert sides[0].isdisjoint(sides[1])
        assert len(sides[0]) + len(sides[1]) == 12


def test_a_single_scene_cannot_be_split(tmp_path):
    with pytest.raises(ValueRangeError, match="at least 2"):
        split_by_scene(PackedReader(write_packed(tmp_path, 1)), 0.1, np.random.default_rng(0))


@pytest.mark.parametrize("count", [50, 300])
def test_regions_are_centred_and_their_labels_with_them(reader, count):
    seen = NetworkConfig(num_points=count, input_frame="camera")
    batch = load_regions(reader, np.array([0, 1]), seen, [np.random.default_rng(i) for i in (0, 1)])
    assert batch.points.shape == (2, count, 3)
    assert float(batch.points.mean(1).abs().max()) < 1e-6
    region = reader[0]
    shift = batch.points[0, 0].numpy() - region.points
    row = np.abs(shift - (batch.center[0, 0].numpy() - region.point[0])).sum(1).argmin()
    np.testing.assert_allclose(
        region.points[row] - region.point[0],
        (batch.points[0, 0] - batch.center[0, 0]).numpy(),
        atol=1e-6,
    )
    assert not batch.center[1, 1].any()  # a can has one plane: nan is replaced by zeros


@pytest.mark.parametrize("known", [True, False])
def test_points_and_labels_are_turned_to_the_table_together(reader, known):
    plane = Plane(unit(np.array([0.2, -0.6, -0.7])), 0.6)
    region = dataclasses.replace(reader[0], table=table_row(plane if known else None))
    count = len(region.points)  # all of them: their centroid does not depend on the draw
    seen = [NetworkConfig(num_points=count, input_frame=frame) for frame in ("camera", "table")]
    camera, table = (draw_points(region, each, np.random.default_rng(0)) for each in seen)
    axes = level_axes(region.points.mean(0), plane if known else None)
    for name, index in (("points", 0), ("centers", 3), ("directions", 4)):
        np.testing.assert_allclose(table[index], camera[index] @ axes.T, atol=1e-6, err_msg=name)
    height = plane.height(region.points.mean(0)) if known else 0.0
    assert table[5] == pytest.approx(height, abs=1e-6)
    assert camera[5] == 0.0


@pytest.mark.parametrize("count", [50, 120, 300])
def test_points_are_drawn_in_random_order(reader, count):
    line = np.linspace(0.0, 1.0, len(reader[0].points), dtype=np.float32)
    region = dataclasses.replace(reader[0], points=np.column_stack([line] * 3))
    settings = NetworkConfig(num_points=count, input_frame="camera")
    points = draw_points(region, settings, np.random.default_rng(0))[0]
    assert abs(np.corrcoef(points[:, 0], np.arange(count))[0, 1]) < 0.3


def test_a_share_of_the_tables_is_dropped(reader):
    plane = Plane(unit(np.array([0.2, -0.6, -0.7])), 0.6)
    region = dataclasses.replace(reader[0], table=table_row(plane))
    draws = (np.random.default_rng(i) for i in range(200))
    lost = [draw_points(region, NetworkConfig(num_points=20), rng, 0.25)[5] == 0 for rng in draws]
    assert 30 < sum(lost) < 70


def test_prefetch_keeps_the_order():
    assert list(prefetch(lambda i: i * i, range(20))) == [i * i for i in range(20)]


def test_a_fault_while_loading_is_raised_where_its_batch_was_due():
    def load(i):
        if i == 3:
            raise ValueRangeError("item", i, "another")
        return i

    got = prefetch(load, range(9))
    assert [next(got) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueRangeError):
        next(got)


def test_a_prefetch_that_is_closed_stops_its_thread():
    loaded = []
    got = prefetch(lambda i: loaded.append(i) or i, range(1000))
    next(got)
    got.close()
    assert len(loaded) < 10


@pytest.mark.parametrize("processes", [0, 2])
def test_batches_loaded_ahead_come_in_the_order_of_their_steps(processes):
    got = list(load_ahead(lambda step: [step, torch.full((2,), step)], range(3, 8), processes))
    assert [(step, numbers.tolist()) for step, numbers in got] == [(i, [i, i]) for i in range(3, 8)]


@pytest.mark.parametrize("processes", [0, 2])
def test_nothing_is_loaded_ahead_for_no_steps(processes):
    assert list(load_ahead(lambda step: step, range(0), processes)) == []


def test_a_fault_in_a_loading_process_names_its_cause():
    def load(step):
        if step == 3:
            raise ValueRangeError("item", step, "another")
        return step

    got = load_ahead(load, range(9), 2)
    assert [next(got) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueRangeError, match="item"):
        next(got)
    got.close()


def test_a_training_that_is_to_stop_does_not_wait_for_a_missing_batch():
    never = threading.Event()
    got = load_ahead(lambda step: never.wait() if step else step, range(3), is_stopped=lambda: True)
    assert list(got) == [0]
    never.set()
