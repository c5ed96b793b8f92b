"""grasps.h5 read one frame at a time: the same as the whole file at once."""

from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_parts import merge_parts
from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.grasp_files.grasps_tables import FrameResult
from tests.grasp_files.test_grasps_file import STAMP, result
from tests.grasp_files.whole_file import read_whole

RESULTS = [
    result("s/a", 2, 3),
    FrameResult("b", "failed", "b_depth.png: depth has 8 bits; ümlaut"),
    result("c", 0, 0),
    result("d", 3, 7, seed=1),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    grasps_file.write(tmp_path / "g.h5", RESULTS, STAMP)
    return tmp_path / "g.h5"


def assert_same(one: FrameResult, other: FrameResult) -> None:
    for name in ("name", "status", "message", "intrinsics", "seconds"):
        assert getattr(one, name) == getattr(other, name)
    for first, second in ((one.regions, other.regions), (one.grasps, other.grasps)):
        for field in fields(first):
            assert_array_equal(getattr(first, field.name), getattr(second, field.name))


def test_frames_read_one_by_one_equal_the_written_frames(path):
    for order in ([0, 1, 2, 3], [3, 1]):
        for place, found in zip(order, read_results(path, order), strict=True):
            assert_same(found, RESULTS[place])


@pytest.mark.parametrize("batch", [1, 2, 64])
@pytest.mark.parametrize(
    ("places", "kept"),  # as results, not as parts
    [
        ([], set()),
        ([1], set()),
        *(([2, 1], kept) for kept in (set(), {2})),
        *(([0, 1, 2, 3], kept) for kept in (set(), {0}, {0, 2, 3})),
        *(([3, 4, 0, 1], kept) for kept in (set(), {0}, {0, 3})),
    ],
)
def test_joined_parts_give_the_file_that_is_written_at_once(
    tmp_path, monkeypatch, batch, places, kept
):
    monkeypatch.setattr("pipelines.grasp_files.grasps_parts.BATCH", batch)
    frames = [
        result("s/a", 2, 3),
        FrameResult("b", "failed", "no depth"),
        result("c", 0, 0),
        result("d", 3, 7, seed=1),
        result("e", 3, 7, seed=1),
    ]
    parts = []
    for number, place in enumerate(places):
        if frames[place].status == "failed" or place in kept:
            parts.append(frames[place])
            continue
        parts.append(tmp_path / f"{number}.h5")
        grasps_file.write(parts[-1], [frames[place]], STAMP)
    merge_parts(tmp_path / "merged.h5", parts, STAMP, {"network": "abc"})
    grasps_file.write(tmp_path / "g.h5", [frames[i] for i in places], STAMP, {"network": "abc"})
    merged, whole = (read_whole(tmp_path / name) for name in ("merged.h5", "g.h5"))
    assert dict(merged.attrs) == dict(whole.attrs)
    for found, expected in zip(merged.results, whole.results, strict=True):
        assert_same(found, expected)
    with h5py.File(tmp_path / "merged.h5") as one, h5py.File(tmp_path / "g.h5") as other:
        assert described(one) == described(other)


def described(file: h5py.File) -> dict[str, object]:
    found: dict[str, object] = {}
    file.visititems(
        lambda name, item: found.update(
            {name: (str(getattr(item, "dtype", "")), getattr(item, "shape", ()), dict(item.attrs))}
        )
    )
    return found


def test_the_index_names_frames_and_settings(path):
    index = read_index(path)
    assert index.names == ["s/a", "b", "c", "d"]
    assert index.statuses == [result.status for result in RESULTS]
    assert index.attrs["config"] == {"gripper": "rg2"}


@pytest.mark.parametrize("damage", ["grasps/width", "grasps", "regions/mask_start"])
def test_a_file_without_a_column_is_reported_in_one_sentence(path, damage):
    with h5py.File(path, "a") as file:
        del file[damage]
    with pytest.raises(FormatError, match="has no"):
        read_index(path)


def test_columns_of_unequal_length_are_refused(path):
    with h5py.File(path, "a") as file:
        del file["grasps/width"]
        file["grasps/width"] = np.zeros(3, np.float32)
    with pytest.raises(FormatError, match="disagree"):
        read_index(path)


def test_a_frame_with_inconsistent_rows_is_named(path):
    with h5py.File(path, "a") as file:
        file["grasps/region"][...] = 99
    with pytest.raises(FormatError, match="frame 3"):
        list(read_results(path, [3]))


@pytest.mark.parametrize("group", ["grasps", "regions"])
@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda frame: [*frame[:-1], 4], "but the file has 4 frames"),
        (lambda frame: [-1, *frame[1:]], "-1 to 3"),
        (lambda frame: frame[::-1], "does not ascend"),
    ],
)
def test_rows_that_bisection_would_lose_are_refused(path, group, change, fault):
    with h5py.File(path, "r+") as file:
        column = file[f"{group}/frame"]
        column[...] = change(column[:])
    with pytest.raises(FormatError, match=fault):
        read_index(path)


def test_two_frames_of_one_name_are_refused(path):
    with h5py.File(path, "r+") as file:
        names = file["frames/name"]
        names[2] = names[0]
    with pytest.raises(FormatError, match="has 2 frames named 's/a'; give each its own name"):
        read_index(path)


@pytest.mark.parametrize("block", [b"TREE", b"SNOD", b"HEAP"])
def test_a_damaged_block_anywhere_is_reported_in_one_sentence(path, block):
    data = path.read_bytes()
    for count in range(1, data.count(block) + 1):
        damaged = data.replace(block, b"XXXX", count)
        path.write_bytes(damaged)
        for reads in (
            lambda: list(read_results(path, range(4))),
            lambda: read_index(path),
        ):
            with pytest.raises(FormatError):
                reads()


@pytest.mark.parametrize("region", [-1, 2])
def test_a_grasp_of_no_region_is_reported_in_one_sentence(path, region):
    with h5py.File(path, "r+") as file:
        file["grasps/region"][0] = region
    with pytest.raises(FormatError, match="region of a grasp"):
        next(read_results(path, [0]))
