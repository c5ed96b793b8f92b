"""grasps.h5: columns, parts, resuming."""

import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError, ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_parts import merge_parts
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from pipelines.storage.provenance import make_stamp, read_stamp
from tests.grasp_files.whole_file import read_whole

CAMERA = Intrinsics(60.0, 60.0, 32.0, 24.0, 64, 48)
STAMP = make_stamp("infer", {"gripper": "rg2"}, seed=3, inputs={"network": "sha256:00"})


def result(name: str, regions: int, grasps: int, seed: int = 0) -> FrameResult:
    rng = np.random.default_rng(seed)
    masks = [rng.random((48, 64)) > 0.5 for _ in range(regions)]
    table = RegionTable.from_masks(
        masks,
        confidence=rng.random(regions),
        source=["geometric"] * regions,
        symmetry_confidence=rng.random((regions, 5)),
        symmetry_point=np.full((regions, 5, 3), np.nan),
        symmetry_direction=rng.random((regions, 5, 3)),
        affordance_mean=rng.random(regions),
        affordance_max=rng.random(regions),
    )
    found = GraspTable(
        region=rng.integers(0, max(regions, 1), grasps),
        rotation=rng.random((grasps, 3, 3)),
        translation=rng.random((grasps, 3)),
        width=rng.random(grasps),
        contacts=rng.random((grasps, 2, 3)),
        affordance=rng.random(grasps),
        symmetry_slot=np.full(grasps, -1),
        source=np.array(["planar"] * grasps, object),
        clearance=rng.random(grasps),
        enclosed_height=rng.random(grasps),
        rank_score=rng.random(grasps),
        is_best=rng.random(grasps) > 0.5,
    )
    return FrameResult(name, "ok" if grasps else "empty", "", CAMERA, 0.25, table, found)


@pytest.fixture
def results() -> list[FrameResult]:
    failed = FrameResult("b", "failed", "b_depth.png: depth has 8 bits; ümlaut")
    return [result("s/a", 2, 3), failed, result("c", 0, 0), result("d", 3, 7, seed=1)]


def test_indices_are_local_in_a_frame_and_global_in_the_file(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    grasps_file.write(tmp_path / "g.h5", results, STAMP)
    file = read_whole(tmp_path / "g.h5")
    assert file.regions.frame.tolist() == [0, 0, 3, 3, 3]
    assert file.grasps.frame.tolist() == [0] * 3 + [3] * 7
    assert_array_equal(file.grasps.region[3:], results[3].grasps.region + 2)
    mask = file.regions.mask(3, 64, 48)
    assert_array_equal(mask, results[3].regions.mask(1, 64, 48))


def test_a_file_taken_apart_and_written_again_has_the_same_bytes(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    grasps_file.write(tmp_path / "g.h5", results, STAMP)
    grasps_file.write(tmp_path / "h.h5", read_whole(tmp_path / "g.h5").results, STAMP)
    assert (tmp_path / "g.h5").read_bytes() == (tmp_path / "h.h5").read_bytes()


def test_the_order_in_which_weights_and_settings_are_named_changes_no_byte(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    names = {"network": "sha256:00", "detector": "sha256:01"}
    for name, order in (("g", list(names)), ("h", list(names)[::-1])):
        weights = {key: names[key] for key in order}
        stamp = make_stamp("infer", dict.fromkeys(order, 1), seed=3, inputs=weights)
        grasps_file.write(tmp_path / f"{name}.h5", results, stamp)
    assert (tmp_path / "g.h5").read_bytes() == (tmp_path / "h.h5").read_bytes()


def test_a_resumed_run_gives_the_bytes_of_an_uninterrupted_one(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    whole, resumed = tmp_path / "whole.h5", tmp_path / "resumed.h5"
    grasps_file.write(whole, results, STAMP)
    time.sleep(1.05)  # a file that holds dates would differ
    for item in results:
        grasps_file.write(grasps_file.part_path(resumed, item.name), [item], STAMP)
    paths = [grasps_file.part_path(resumed, item.name) for item in results]
    grasps_file.write(resumed, [grasps_file.read_part(path) for path in paths], STAMP)
    grasps_file.remove_parts(resumed)
    assert resumed.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["resumed.h5", "whole.h5"]


def test_parts_are_stamped_and_named_apart(tmp_path: Path) -> None:
    names = ["a/b", "a_b", "a%2Fb", "x" * 300, "y" + "x" * 299]
    paths = [grasps_file.part_path(tmp_path / "g.h5", name) for name in names]
    assert len(set(paths)) == len(names)
    for path in paths:
        grasps_file.write(path, [result("n", 1, 1)], STAMP)
        assert (read_stamp(path) or {})["seed"] == 3


def test_parts_in_a_linked_folder_are_removed_and_the_link_stays(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    output, far = tmp_path / "g.h5", tmp_path / "far"
    far.mkdir()
    grasps_file.parts_folder(output).symlink_to(far)
    grasps_file.write(grasps_file.part_path(output, "a"), results[:1], STAMP)
    grasps_file.remove_parts(output)
    assert grasps_file.parts_folder(output).is_symlink()
    assert not list(far.iterdir())


def test_statuses_messages_and_cameras_are_read_back(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    grasps_file.write(tmp_path / "g.h5", results, STAMP)
    again = read_whole(tmp_path / "g.h5").results
    assert [item.status for item in again] == ["ok", "failed", "empty", "ok"]
    assert again[1].message == results[1].message
    assert again[1].intrinsics is None
    assert again[1].size == (0, 0)
    assert again[0].intrinsics == CAMERA
    assert again[0].seconds == 0.25


def test_attributes_record_how_the_file_was_made(tmp_path: Path) -> None:
    grasps_file.write(tmp_path / "g.h5", [], STAMP)
    file = read_whole(tmp_path / "g.h5")
    assert len(file.frames.name) == len(file.regions) == len(file.grasps) == 0
    assert file.attrs["config"] == {"gripper": "rg2"}
    assert file.attrs["weights"] == {"network": "sha256:00"}
    assert file.attrs["seed"] == 3
    assert file.attrs["format_version"] == 6


def test_the_public_columns_have_their_types_and_units(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    grasps_file.write(tmp_path / "g.h5", results, STAMP)
    with h5py.File(tmp_path / "g.h5") as file:
        assert file["grasps/translation"].attrs["units"] == "m"
        assert file["grasps/rotation"].dtype == np.float32
        assert file["grasps/is_best"].dtype == bool
        assert file["frames/intrinsics"].dtype == np.float64
        assert file["frames/name"].asstr()[0] == "s/a"
        assert file["regions/mask_start"].shape == (6,)


def test_a_truncated_file_is_reported_in_one_sentence(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    path = tmp_path / "g.h5"
    grasps_file.write(path, results, STAMP)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(FormatError, match=r"g\.h5"):
        read_whole(path)


@pytest.mark.parametrize("damage", ["grasps/width", "grasps", "regions/mask_start"])
def test_a_file_without_a_column_is_reported_in_one_sentence(
    tmp_path: Path, results: list[FrameResult], damage: str
) -> None:
    path = tmp_path / "g.h5"
    grasps_file.write(path, results, STAMP)
    with h5py.File(path, "a") as file:
        del file[damage]
    with pytest.raises(FormatError, match=damage):
        read_whole(path)


def replace_column(path: Path, name: str, content: np.ndarray) -> None:
    with h5py.File(path, "a") as file:
        del file[name]
        file[name] = content


def test_columns_of_unequal_length_are_refused(tmp_path: Path, results: list[FrameResult]) -> None:
    path = tmp_path / "g.h5"
    grasps_file.write(path, results, STAMP)
    replace_column(path, "grasps/affordance", np.zeros(2, np.float32))
    with pytest.raises(FormatError, match="disagree"):
        read_whole(path)


@pytest.mark.parametrize(("group", "name"), [("grasps", "width"), ("regions", "box")])
def test_texts_in_place_of_numbers_are_refused(
    tmp_path: Path, results: list[FrameResult], group: str, name: str
) -> None:
    path = tmp_path / "g.h5"
    grasps_file.write(path, results, STAMP)
    numbers = getattr(getattr(read_whole(path), group), name)
    texts = np.full(numbers.shape, "wide", dtype=h5py.string_dtype())
    replace_column(path, f"{group}/{name}", texts)
    with pytest.raises(FormatError, match=rf"g\.h5: .*{name} .*wide"):
        read_whole(path)


def written_by_version_1(path: Path, results: list[FrameResult]) -> None:
    """Write a file without the columns that version 2 added; `existence` holds confidence."""
    stamp = make_stamp("infer", {"method": "network", "selection": {"rank_by": "critic"}})
    grasps_file.write(path, results, stamp)
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 1
        del file["grasps/ranker"], file["regions/existence"], file["regions/status"]
        del file["grasps/symmetry_source"], file["regions/instance"]
        file.move("regions/symmetry_confidence", "regions/existence")


def test_a_file_of_version_1_is_read(tmp_path: Path, results: list[FrameResult]) -> None:
    path, merged = tmp_path / "old.h5", tmp_path / "new.h5"
    written_by_version_1(path, results)
    whole = read_whole(path)
    expected = np.concatenate([each.regions.symmetry_confidence for each in results])
    assert_array_equal(whole.regions.symmetry_confidence, expected)
    assert np.isnan(whole.regions.existence).all()
    assert set(whole.grasps.ranker) == {"critic"}
    part = grasps_file.part_path(tmp_path / "g.h5", "s/a")
    part.parent.mkdir()
    written_by_version_1(part, results[:1])
    merge_parts(merged, [part], STAMP)
    assert set(read_whole(merged).grasps.ranker) == {"critic"}


def test_grasps_of_each_frame_are_ordered_by_their_scores(
    tmp_path: Path, results: list[FrameResult]
) -> None:
    grasps_file.write(tmp_path / "g.h5", results, STAMP)
    table = read_whole(tmp_path / "g.h5").grasps
    for frame in (0, 3):
        mine = table.frame == frame
        by_rank = table.rank_score[mine][np.argsort(table.rank_in_frame[mine])]
        assert by_rank.tolist() == sorted(by_rank, reverse=True)
        assert sorted(table.rank_in_frame[mine]) == list(range(mine.sum()))


def test_a_file_of_version_2_gets_its_order_and_the_mark_of_grasps_worth_trying(
    tmp_path: Path,
) -> None:
    found = result("a", 2, 6)
    scores = {"rank_score": np.linspace(0.1, 0.9, 6), "rank_in_frame": np.zeros(0)}
    critic = replace(found.grasps, ranker=np.full(6, "critic", object), **scores)
    path = tmp_path / "g.h5"
    grasps_file.write(path, [replace(found, grasps=critic)], STAMP)
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = 2
        del file["grasps/rank_in_frame"], file["grasps/worth_trying"], file["regions/status"]
        del file["grasps/symmetry_source"]
    assert read_whole(path).grasps.symmetry_source.tolist() == [""] * 6
    assert read_whole(path).regions.status.tolist() == ["measured"] * 2
    table = read_whole(path).grasps
    assert table.rank_in_frame.tolist() == critic.rank_in_frame.tolist()
    assert table.worth_trying.tolist() == (critic.rank_score >= 0.3).tolist()
    assert not table.worth_trying.all()


def test_a_file_of_version_5_has_no_instances(tmp_path: Path, results: list[FrameResult]) -> None:
    numbered = replace(results[0].regions, instance=[7, 2])
    path = tmp_path / "g.h5"
    grasps_file.write(path, [replace(results[0], regions=numbered), *results[1:]], STAMP)
    assert read_whole(path).regions.instance.tolist() == [7, 2, -1, -1, -1]
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = 5
        del file["regions/instance"]
    assert read_whole(path).regions.instance.tolist() == [-1] * 5


def test_a_file_of_a_later_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "g.h5"
    grasps_file.write(path, [], STAMP)
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = 99
    with pytest.raises(FormatError, match="99"):
        read_whole(path)


def test_inconsistent_results_are_refused() -> None:
    with pytest.raises(ValueRangeError, match="status"):
        FrameResult("a", "fine")
    with pytest.raises(ValueRangeError, match="region"):
        FrameResult("a", "ok", grasps=result("a", 2, 3).grasps)
    with pytest.raises(ValueRangeError, match="must be texts"):
        replace(result("a", 2, 3).grasps, symmetry_source=np.ones(3))
