"""`read_grasps`: a file of grasps by the names of its frames."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from pipelines.errors import FormatError, SymgraspError
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.exports.export_poses import ExportGripper
from pipelines.grasp_files.exports.grasp_exports import FrameGrasps
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import gripper_digest, load_gripper
from pipelines.storage.provenance import make_stamp
from symgrasp import read_grasps
from symgrasp.grasps import ordered_grasps
from tests.grasp_files.exports.gripper_toys import random_result
from tests.grasp_files.test_grasps_file import written_by_version_1

RNG = np.random.default_rng(1)
RESULTS = [
    random_result(RNG, 5, "s/a"),
    FrameResult("b", "failed", "b_depth.png: depth has 8 bits"),
    random_result(RNG, 0, "c"),
]


def written(path, gripper="franka", digest=None):
    inputs = {} if digest is None else {"gripper": digest}
    grasps_file.write(path, RESULTS, make_stamp("infer", {"gripper": gripper}, inputs=inputs))
    return path


def test_frames_are_read_by_name_in_the_order_of_the_file(tmp_path):
    frames = read_grasps(str(written(tmp_path / "g.h5")))
    assert list(frames) == ["s/a", "b", "c"]
    assert len(frames) == 3
    assert "c" in frames
    assert "d" not in frames
    assert [grasps.status for grasps in frames.values()] == ["ok", "failed", "empty"]
    expected = ordered_grasps(RESULTS[0], load_gripper("franka"))
    for column in ("rotation", "width", "rank_score", "region"):
        np.testing.assert_array_equal(getattr(frames["s/a"], column), getattr(expected, column))
    assert frames["s/a"].name == "s/a"
    np.testing.assert_array_equal(frames["s/a"].regions[1].mask, expected.regions[1].mask)


def test_a_failed_frame_has_no_grasps_and_gives_the_reason(tmp_path):
    frame = read_grasps(written(tmp_path / "g.h5"))["b"]
    assert (len(frame), frame.regions, frame.intrinsics) == (0, (), None)
    with pytest.raises(SymgraspError, match="depth has 8 bits"):
        _ = frame.best


def test_a_row_that_is_no_grasp_is_reported_in_one_sentence(tmp_path):
    path = written(tmp_path / "g.h5")
    with h5py.File(path, "r+") as file:
        file["grasps/rotation"][0] = np.nan
    with pytest.raises(SymgraspError, match=r"g\.h5, frame 's/a': the rotation of a grasp is not"):
        read_grasps(path)["s/a"]


def test_a_missing_frame_raises_a_key_error_of_one_sentence(tmp_path):
    frames = read_grasps(written(tmp_path / "g.h5"))
    with pytest.raises(SymgraspError, match=r"^frame of .*g.h5 'a' is not known; known are b, c"):
        frames["a"]
    assert frames.get("a") is None
    with pytest.raises(KeyError, match=r"g.h5 0 is not known; known are b, c"):
        frames[0]


def test_poses_are_for_the_gripper_that_the_grasps_were_found_for_or_for_a_named_one(tmp_path):
    path = written(tmp_path / "g.h5")
    assert read_grasps(path).gripper == load_gripper("franka")
    assert read_grasps(path, "rg2").gripper == load_gripper("rg2")
    own = replace(load_gripper("rg2"), flange_to_tip=0.3)
    assert read_grasps(path, own)["s/a"].gripper is own


def test_grasps_that_a_named_gripper_cannot_open_to_are_left_out_as_in_exports(tmp_path):
    path, narrow = written(tmp_path / "g.h5"), replace(load_gripper("rg2"), max_opening=0.06)
    every, held = read_grasps(path, "rg2")["s/a"], read_grasps(path, narrow)["s/a"]
    exported = ExportGripper(narrow, narrow.base_to_contacts, "rg2")
    expected = FrameGrasps.of(RESULTS[0], 0, exported).result.grasps
    assert 0 < len(held) < len(every) == 5
    assert held.opening.max() <= narrow.max_opening
    for column in ("width", "rank_in_frame", "is_best", "region"):
        np.testing.assert_array_equal(getattr(held, column), getattr(expected, column))
    thin = replace(narrow, max_opening=2.1 * narrow.clearance)
    with pytest.raises(SymgraspError, match="all were left out"):
        _ = read_grasps(path, thin)["s/a"].best


def test_a_gripper_whose_file_is_gone_or_has_changed_must_be_named(tmp_path):
    gone = written(tmp_path / "gone.h5", str(tmp_path / "mine.toml"))
    with pytest.raises(SymgraspError, match=r"mine.toml.* no longer exists"):
        read_grasps(gone)
    changed = written(tmp_path / "changed.h5", "franka", gripper_digest("rg2"))
    with pytest.raises(SymgraspError, match="has other measures now"):
        read_grasps(changed)
    assert len(read_grasps(gone, "rg2")["s/a"].poses()) == 5


def test_frames_keep_their_names_when_the_file_is_written_again(tmp_path):
    path = written(tmp_path / "g.h5")
    frames = read_grasps(path)
    first = frames["s/a"]
    stamp = make_stamp("infer", {"gripper": "franka"})
    added = random_result(RNG, 3, "a")
    grasps_file.write(path, [added, *RESULTS[:2]], stamp)
    np.testing.assert_array_equal(frames["s/a"].width, first.width)
    assert (frames["s/a"].name, frames["b"].name) == ("s/a", "b")
    with pytest.raises(SymgraspError, match=r"again without the frame 'c'; call read_grasps again"):
        frames["c"]
    grasps_file.write(path, [added], stamp)
    with pytest.raises(SymgraspError, match=r"again without the frame 'b'"):
        frames["b"]
    written(path, "rg2")
    with pytest.raises(SymgraspError, match=r"g\.h5 has been written again with other settings"):
        frames["b"]


def test_a_file_of_version_1_is_read(tmp_path):
    written_by_version_1(tmp_path / "g.h5", RESULTS)
    frames = read_grasps(tmp_path / "g.h5")
    assert list(frames) == ["s/a", "b", "c"]
    expected = ordered_grasps(RESULTS[0], load_gripper("rg2"))
    np.testing.assert_array_equal(frames["s/a"].rotation, expected.rotation)
    for one, other in zip(frames["s/a"].symmetries, expected.symmetries, strict=True):
        assert one.confidence == other.confidence
        assert np.isnan(one.existence)


def test_a_file_without_grasps_is_refused_in_one_sentence(tmp_path):
    (tmp_path / "g.h5").write_text("grasps")
    with pytest.raises(FormatError, match=r"g\.h5"):
        read_grasps(tmp_path / "g.h5")
    with pytest.raises(SymgraspError, match=r"none\.h5"):
        read_grasps(tmp_path / "none.h5")
