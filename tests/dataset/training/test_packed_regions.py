"""Packed region clouds and random access to them."""

import pickle
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.dataset.training import packed_regions
from pipelines.dataset.training.packed_regions import COLUMNS, PackedReader, PackedScene
from pipelines.errors import FormatError, MissingInputError, ValueRangeError
from pipelines.storage.provenance import digest_folder, is_finished, make_stamp

STAMP = make_stamp("pack", {"num_points": 16})


def packed(count: int, first_id: int = 0) -> PackedScene:
    rng = np.random.default_rng(first_id)
    direction = rng.random((count, 5, 3))
    return PackedScene(
        points=rng.random((count, 16, 3)),
        affordance=rng.random((count, 16)),
        existence=rng.random((count, 5)) > 0.5,
        point=rng.random((count, 5, 3)),
        direction=direction / np.linalg.norm(direction, axis=-1, keepdims=True),
        table=np.full((count, 4), np.nan),
        object_id=np.arange(count) + first_id,
        frame_id=np.zeros(count),
        name=np.array([f"part {i}" for i in range(count)], object),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number, count in enumerate((3, 0, 2)):
        path = tmp_path / f"scene_{number:04d}.h5"
        packed_regions.write(path, packed(count, 10 * number), STAMP)
    return tmp_path


def test_a_scene_comes_back_as_it_was(folder: Path) -> None:
    again = packed_regions.read(folder / "scene_0000.h5")
    for name in COLUMNS:
        assert_array_equal(getattr(again, name), getattr(packed(3), name))
    assert again.points.dtype == np.float32
    assert is_finished(folder / "scene_0000.h5", STAMP)


def test_no_more_files_are_open_than_systems_allow(folder: Path, monkeypatch) -> None:
    monkeypatch.setattr(packed_regions, "MOST_OPEN", 2)
    for number in range(3, 8):
        packed_regions.write(folder / f"scene_{number:04d}.h5", packed(1, 10 * number), STAMP)
    reader = PackedReader(folder)
    for index in (*range(len(reader)), 0, 4, 9):
        scene, row = reader.locate(index)
        assert reader[index].object_id == 10 * scene + row
        held = {Path(link.resolve()) for link in Path("/proc/self/fd").iterdir() if link.exists()}
        assert len(held & set(reader.paths)) <= 2


def test_regions_are_counted_through_the_files(folder: Path) -> None:
    reader = PackedReader(folder)
    assert len(reader) == 5
    assert [reader[i].object_id for i in range(5)] == [0, 1, 2, 20, 21]
    assert reader[-1].name == "part 1"
    assert [reader.locate(i) for i in (0, 2, 3)] == [(0, 0), (0, 2), (2, 0)]
    assert_array_equal(reader[4].points, packed(2, 20).points[1])
    with pytest.raises(IndexError):
        reader[5]


def test_points_are_stored_a_region_a_chunk(folder: Path) -> None:
    with h5py.File(folder / "scene_0000.h5") as file:
        assert file["points"].chunks == (1, 16, 3)
        assert file["affordance"].chunks == (1, 16)
        assert file["object_id"].chunks is None


def test_files_without_chunks_of_an_earlier_version_are_read(folder: Path) -> None:
    with h5py.File(folder / "scene_0002.h5", "a") as file:
        points = file["points"][()]
        del file["points"]
        file["points"] = points
        assert file["points"].chunks is None
    assert_array_equal(PackedReader(folder)[4].points, packed(2, 20).points[1])


@settings(max_examples=20, deadline=None)
@given(st.permutations(range(5)))
def test_regions_read_in_any_order_are_those_of_the_scene(order: list[int]) -> None:
    with tempfile.TemporaryDirectory() as name:
        scenes = {Path(name) / "a.h5": packed(3), Path(name) / "b.h5": packed(2, 7)}
        for path, scene in scenes.items():
            packed_regions.write(path, scene, STAMP)
        reader = PackedReader(Path(name))
        for index in order:
            scene = packed(3) if index < 3 else packed(2, 7)
            for column in COLUMNS:
                read = getattr(reader[index], column)
                assert_array_equal(read, getattr(scene, column)[index % 3])


def test_leftovers_of_an_interrupted_run_are_not_read(folder: Path) -> None:
    (folder / ".scene_0001.x7.h5").write_bytes(b"half a scene")
    assert len(PackedReader(folder)) == 5
    before = digest_folder(folder, "*.h5")
    (folder / ".scene_0001.x7.h5").unlink()
    assert digest_folder(folder, "*.h5") == before


def test_a_reader_in_use_can_be_sent_to_other_processes(folder: Path) -> None:
    reader = PackedReader(folder)
    before = reader[3]
    after = pickle.loads(pickle.dumps(reader))[3]
    assert_array_equal(before.points, after.points)


def test_an_empty_folder_names_the_stage_that_fills_it(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match="symgrasp pack"):
        PackedReader(tmp_path)


def test_a_scene_of_unequal_columns_is_refused() -> None:
    with pytest.raises(ValueRangeError, match="object_id"):
        PackedScene(**{**vars(packed(3)), "object_id": np.arange(2)})


def test_damaged_scenes_are_reported_in_one_sentence(folder: Path) -> None:
    with h5py.File(folder / "scene_0000.h5", "a") as file:
        del file["affordance"]
    with pytest.raises(FormatError, match="scene_0000"):
        PackedReader(folder)[0]
    path = folder / "scene_0002.h5"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(FormatError, match="scene_0002"):
        PackedReader(folder)


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_of_another_shape_are_reported_in_one_sentence(folder: Path, name: str) -> None:
    with h5py.File(folder / "scene_0000.h5", "a") as file:
        column = file[name][()]
        del file[name]
        file[name] = column[..., None]
    with pytest.raises(FormatError, match=f"/{name}"):
        PackedReader(folder)[0]


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("points", np.nan, "region 1 has points that are not finite or beyond 100 m"),
        ("points", 500.0, "region 1 has points that are not finite or beyond 100 m"),
        ("affordance", np.nan, "region 1 has affordances outside of 0 to 1"),
        ("affordance", 7.0, "region 1 has affordances outside of 0 to 1"),
        ("existence", np.nan, "region 1 has an existence outside of 0 to 1"),
        ("existence", 3.0, "region 1 has an existence outside of 0 to 1"),
        ("point", np.nan, "region 1 has a symmetry without a point"),
        ("direction", np.nan, "region 1 has a symmetry without a unit direction"),
        ("direction", 5.0, "region 1 has a symmetry without a unit direction"),
        ("table", 0.0, "region 1 has a table without a unit normal"),
    ],
)
def test_labels_that_no_network_can_learn_from_are_named(folder, name, value, fault) -> None:
    path = folder / "scene_0000.h5"
    with h5py.File(path, "r+") as file:
        rows = file[name][()]
        rows[1].flat[:4] = value
        file[name][...] = rows
        existence = file["existence"][()]
        existence[1, 0] = value if name == "existence" else 1.0
        file["existence"][...] = existence
    with pytest.raises(FormatError, match=f"scene_0000.h5: {fault}"):
        PackedReader(folder)[1]
    assert PackedReader(folder)[3].object_id == 20


def test_a_sphere_has_no_direction_and_an_empty_slot_nothing(folder) -> None:
    with h5py.File(folder / "scene_0000.h5", "r+") as file:
        file["existence"][...] = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
        file["direction"][...] = np.nan
        point = file["point"][()]
        point[:, :4] = np.nan
        file["point"][...] = point
    assert PackedReader(folder)[1].existence.sum() == 1.0
