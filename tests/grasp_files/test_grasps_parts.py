"""Parts are joined column by column; a changed part is refused with its reader's error."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError, SymgraspError
from pipelines.grasp_files import grasps_file, grasps_parts
from pipelines.grasp_files.grasps_file import read_part
from pipelines.grasp_files.grasps_parts import merge_parts, part_sizes, part_tables
from pipelines.grasp_files.grasps_tables import FrameResult, Tables, joined_tables, tables_of
from tests.grasp_files.test_grasps_file import CAMERA, STAMP, result

FRAMES = [
    result("s/ä", 2, 3),
    FrameResult("b", "failed", "no depth"),
    FrameResult("e", "empty", "nothing to grasp", CAMERA, np.nan),
    result("d", 3, 7, seed=1),
]


@pytest.fixture
def part(tmp_path: Path) -> Path:
    grasps_file.write(tmp_path / "a.h5", [FRAMES[3]], STAMP)
    return tmp_path / "a.h5"


def assert_same_tables(found: Tables, expected: Tables) -> None:
    assert {group: list(columns) for group, columns in found.items()} == {
        group: list(columns) for group, columns in expected.items()
    }
    for group, columns in expected.items():
        for name, column in columns.items():
            assert_array_equal(found[group][name], column, f"{group}/{name}")


@pytest.mark.parametrize("frame", FRAMES)
def test_a_part_gives_the_columns_of_its_frame(tmp_path: Path, frame: FrameResult) -> None:
    path = tmp_path / "a.h5"
    grasps_file.write(path, [frame], STAMP)
    assert_same_tables(part_tables(path), tables_of([frame]))
    runs = len(frame.regions.mask_counts)
    assert part_sizes(path) == (len(frame.regions), len(frame.grasps), runs)


def test_columns_of_a_sound_part_are_read_without_building_its_frame(
    part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grasps_parts, "read_part", None)
    assert_same_tables(part_tables(part), tables_of([FRAMES[3]]))


@pytest.mark.parametrize("places", [[0], [1, 2], [0, 1, 2, 3], [3, 3, 0, 2]])
def test_joined_columns_equal_those_of_all_frames_together(places: list[int]) -> None:
    frames = [FRAMES[place] for place in places]
    tables = joined_tables([tables_of([frame]) for frame in frames])
    assert_same_tables(tables, tables_of(frames))
    regions, grasps, first = tables["regions"], tables["grasps"], 0
    assert tables["frames"]["name"].tolist() == [frame.name for frame in frames]
    for place, frame in enumerate(frames):
        mine = grasps["frame"] == place
        assert_array_equal(grasps["region"][mine], frame.grasps.region + first)
        assert_array_equal(grasps["width"][mine], frame.grasps.width)
        for region in range(len(frame.regions)):
            assert regions["frame"][first] == place
            own = slice(*frame.regions.mask_start[region : region + 2])
            runs = regions["mask_counts"][slice(*regions["mask_start"][first : first + 2])]
            assert_array_equal(runs, frame.regions.mask_counts[own])
            first += 1
    assert len(regions["frame"]) == first


def replaced(name: str, content: object) -> object:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = content

    return change


def value(name: str, place: object, content: object) -> object:
    def change(file: h5py.File) -> None:
        file[name][place] = content

    return change


@pytest.mark.parametrize(
    "change",
    [
        value("grasps/region", 0, 3),
        value("grasps/region", 6, -1),
        value("frames/status", 0, "fine"),
        value("frames/intrinsics", 0, np.nan),
        value("regions/mask_start", 0, 1),
        value("regions/mask_start", 3, 1),
        replaced("grasps/width", np.zeros(6, np.float32)),
        replaced("grasps/rotation", np.zeros((7, 9), np.float32)),
        replaced("regions/source", [b"\xff"] * 3),
        replaced("regions/mask_start", np.arange(3)),
        replaced("frames/seconds", np.zeros(2, np.float32)),
        replaced("frames/name", np.zeros(1)[:0]),
        lambda file: file.pop("grasps/is_best"),
        lambda file: file.pop("regions/frame"),
        lambda file: file.pop("frames"),
        lambda file: file.attrs.update(format_version=99),
        lambda file: file.attrs.pop("format_version"),
    ],
)
def test_an_inconsistent_part_is_refused_with_the_error_of_its_reader(
    tmp_path: Path, part: Path, change
) -> None:
    with h5py.File(part, "r+") as file:
        change(file)
    with pytest.raises(SymgraspError) as expected:
        read_part(part)
    with pytest.raises(type(expected.value)) as found:
        part_tables(part)
    assert str(found.value) == str(expected.value)
    with pytest.raises(SymgraspError):
        merge_parts(tmp_path / "g.h5", [part], STAMP)
    assert not (tmp_path / "g.h5").exists()


@pytest.mark.parametrize(
    "change",
    [
        replaced("grasps/width", np.ones(7, np.float64)),
        replaced("grasps/symmetry_slot", np.ones(7, np.int64)),
        value("frames/size", 0, 0),
    ],
)
def test_a_part_of_other_types_is_joined_as_its_reader_reads_it(part: Path, change) -> None:
    with h5py.File(part, "r+") as file:
        change(file)
    assert_same_tables(part_tables(part), tables_of([read_part(part)]))


def test_a_damaged_part_is_reported_in_one_sentence(tmp_path: Path, part: Path) -> None:
    data = part.read_bytes()
    for damaged in (data[:3000], data[:2000] + b"x" + data[2001:], b""):
        part.write_bytes(damaged)
        with pytest.raises(FormatError, match=r"a\.h5"):
            merge_parts(tmp_path / "g.h5", [part], STAMP)
