"""All exporters: their shared parts, and the contacts that each format keeps."""

import dataclasses
import json
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.errors import SymgraspError
from pipelines.export import TO_FILE, TO_FOLDER
from pipelines.grasp_files.exports.export_poses import ExportGripper
from pipelines.grasp_files.exports.export_tally import as_ranges
from pipelines.grasp_files.exports.grasp_exports import FrameGrasps, frame_path
from pipelines.grasp_files.grasps_tables import GraspTable
from tests.docs.test_formats_document import TYPES, block, keys_of
from tests.grasp_files.exports import export_readers
from tests.grasp_files.exports.gripper_toys import (
    numbered,
    random_frame,
    random_gripper,
    random_result,
)

FILES = {
    "graspnet": ("a/b.npy", export_readers.graspnet),
    "contact-graspnet": ("a/predictions_b.npz", export_readers.contact_graspnet),
    "isaac": ("a/b.yaml", export_readers.isaac),
    "ros-json": ("a/b.json", export_readers.ros_json),
}
WHOLE = {"json": export_readers.whole_json, "csv": export_readers.whole_csv}
seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=15, deadline=None)


def exported(to: str, frame, header):
    """Return the contacts of `frame` that a reader of the format computes."""
    with tempfile.TemporaryDirectory() as folder:
        if to in WHOLE:
            path = Path(folder) / f"x.{to}"
            TO_FILE[to](path, [frame], header)
            return WHOLE[to](path, frame.result.name)
        name, read = FILES[to]
        TO_FOLDER[to][0](Path(folder) / name, frame, header)
        return read(Path(folder) / name, frame.gripper.model)


def test_every_format_has_a_reader_here():
    assert {*FILES, *WHOLE} == {*TO_FOLDER, *TO_FILE}


@pytest.mark.parametrize("to", [*FILES, *WHOLE])
@few
@given(seed=seeds, count=st.integers(0, 7))
def test_contacts_come_back_from_every_format(to, seed, count):
    frame, header = random_frame(np.random.default_rng(seed), count)
    contacts = exported(to, frame, header)
    assert contacts.shape == (count, 2, 3)
    assert_allclose(contacts, frame.result.grasps.contacts, atol=1e-6)


def test_every_file_names_the_instances_of_the_users_masks(tmp_path):
    frame, header = random_frame(np.random.default_rng(2), 9)
    ids = 4, 2, 9  # of the regions
    frame = numbered(frame, ids)
    expected = [ids[region] for region in frame.result.grasps.region]
    assert len(set(expected)) == 3
    for to in ("json", "csv"):
        TO_FILE[to](tmp_path / to, [frame], header)
    rows = export_readers.csv_rows(tmp_path / "csv")
    assert [int(row["instance"]) for row in rows] == expected
    (whole,) = json.loads((tmp_path / "json").read_text())["frames"]
    assert [grasp["instance"] for grasp in whole["grasps"]] == expected
    for to in ("ros-json", "isaac", "contact-graspnet"):
        TO_FOLDER[to][0](tmp_path / to, frame, header)
    assert json.loads((tmp_path / "ros-json").read_text())["instances"] == expected
    grasps = export_readers.yaml_content(tmp_path / "isaac")["grasps"]
    assert [grasp["instance"] for grasp in grasps.values()] == expected
    with np.load(tmp_path / "contact-graspnet") as arrays:
        ranks = {i: arrays[f"rank_in_frame/{i}"].tolist() for i in ids}
    assert ranks == {i: [r for r, mine in enumerate(expected) if mine == i] for i in ids}


def test_without_masks_there_are_no_instances(tmp_path):
    frame, header = random_frame(np.random.default_rng(2), 9)
    TO_FILE["json"](tmp_path / "json", [frame], header)
    (whole,) = json.loads((tmp_path / "json").read_text())["frames"]
    assert [grasp["instance"] for grasp in whole["grasps"]] == [-1] * 9


@few
@given(seed=seeds)
def test_rotations_are_exact_though_stored_in_single_precision(seed):
    frame, _ = random_frame(np.random.default_rng(seed), 4)
    R = frame.poses[:, :3, :3]
    assert_allclose(R @ R.swapaxes(1, 2), np.eye(3)[None].repeat(4, 0), atol=1e-12)


@few
@given(seed=seeds)
def test_grasps_that_are_too_wide_are_left_out_and_the_next_becomes_the_best(seed):
    rng = np.random.default_rng(seed)
    result, gripper = random_result(rng, 12), random_gripper(rng)
    narrow = type(gripper)(**{**vars(gripper), "max_opening": 0.06})
    frame = FrameGrasps.of(result, 5, ExportGripper(narrow, 0.1, "x"))
    width = result.grasps.width
    assert frame.rows.tolist() == (5 + np.flatnonzero(width <= narrow.max_width)).tolist()
    assert sorted([*frame.rows, *frame.left_out]) == list(range(5, 17))
    held = frame.result.grasps
    assert_allclose(held.contacts, result.grasps.contacts[frame.rows - 5])
    for region in np.unique(held.region):  # toys are sorted, best first
        assert np.flatnonzero(held.is_best[held.region == region]).tolist() == [0]


@few
@given(seed=seeds)
def test_exports_keep_the_order_of_the_frame_and_leave_out_low_scores(seed):
    rng = np.random.default_rng(seed)
    result, gripper = random_result(rng, 12), random_gripper(rng)
    scores = rng.permutation(np.linspace(0.0, 1.0, 12))
    table = dataclasses.replace(result.grasps, rank_score=scores, rank_in_frame=np.zeros(0))
    wide = ExportGripper(dataclasses.replace(gripper, max_opening=0.3), 0.1, "x")
    frame = FrameGrasps.of(dataclasses.replace(result, grasps=table), 5, wide, min_score=0.25)
    assert_allclose(frame.result.grasps.rank_score, np.linspace(1.0, 0.0, 12)[:9], atol=1e-6)
    assert frame.result.grasps.rank_in_frame.tolist() == list(range(9))
    assert_allclose(scores[frame.rows - 5], frame.result.grasps.rank_score, atol=1e-6)
    assert frame.low.tolist() == (5 + np.flatnonzero(scores < 0.25)).tolist()


@pytest.mark.parametrize(
    ("column", "value", "fault"),
    [
        ("translation", np.nan, "translation of a grasp is not finite"),
        ("rank_score", np.inf, "rank_score of a grasp is not finite"),
        ("rotation", np.zeros((3, 3)), "is no rotation"),
        ("rotation", 2.0 * np.eye(3), "is no rotation"),
        ("rotation", np.diag([1.0, 1.0, -1.0]), "is no rotation"),
        ("width", -0.05, "width of a grasp is negative"),
        ("symmetry_slot", 7, "none of -1 to 4"),
        ("symmetry_slot", -5, "none of -1 to 4"),
    ],
)
def test_rows_that_are_no_grasps_are_reported_in_one_sentence(column, value, fault):
    result = random_result(np.random.default_rng(0), 3)
    columns = {name: getattr(result.grasps, name).copy() for name in GraspTable.SPEC}
    columns[column][1] = value
    broken = type(result)(result.name, "ok", regions=result.regions, grasps=GraspTable(**columns))
    exported = ExportGripper(random_gripper(np.random.default_rng(0)), 0.1, "x")
    with pytest.raises(SymgraspError, match=fault):
        FrameGrasps.of(broken, 0, exported)


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a/../../x", "..", "", "a\\..\\x"])
def test_names_that_lead_out_of_the_folder_are_refused(name):
    with pytest.raises(SymgraspError, match="rename the frame"):
        frame_path(name, "", ".npy")


def test_runs_of_consecutive_indices_are_written_as_ranges():
    assert as_ranges(np.array([3, 5, 6, 7, 9])) == "3, 5-7, 9"
    assert as_ranges(np.array([], int)) == ""


def written(to: str, folder: Path, count: int = 4) -> Path:
    frame, header = random_frame(np.random.default_rng(1), count)
    if to in TO_FILE:
        TO_FILE[to](folder / f"x.{to}", [frame], header)
        return folder / f"x.{to}"
    TO_FOLDER[to][0](folder / FILES[to][0], frame, header)
    return folder / FILES[to][0]


@pytest.mark.parametrize("to", [*FILES, *WHOLE])
def test_the_same_grasps_give_the_same_bytes(to, tmp_path):
    assert written(to, tmp_path / "1").read_bytes() == written(to, tmp_path / "2").read_bytes()


def test_the_keys_of_json_exports_are_documented(tmp_path):
    content = json.loads(written("json", tmp_path).read_text())
    (frame,) = content["frames"]
    lines = block("keys", "export json")
    assert set(content) == keys_of(lines)
    assert {*frame, *content["gripper"]} == keys_of(lines, depth=1)
    assert set(frame["grasps"][0]) == keys_of(lines, depth=2)


def test_the_columns_of_csv_exports_are_documented(tmp_path):
    path = written("csv", tmp_path)
    lines = block("keys", "export csv")
    assert set(export_readers.csv_rows(path)[0]) == keys_of(lines, depth=1)
    heads = {key for key in export_readers.csv_facts(path) if key != "SymGrasp grasps"}
    assert heads == keys_of(lines) - {"columns"}


def test_the_keys_of_ros_exports_are_documented(tmp_path):
    content = json.loads(written("ros-json", tmp_path).read_text())
    assert set(content) == keys_of(block("keys", "export ros-json"))


def test_the_keys_of_isaac_exports_are_documented(tmp_path):
    content = export_readers.yaml_content(written("isaac", tmp_path))
    lines = block("keys", "export isaac")
    assert set(content) == keys_of(lines)
    joints = {"cspace_position", "pregrasp_cspace_position"}  # of hands whose joints are known
    assert {*content["grasps"]["grasp_0"], *joints} == keys_of(lines, depth=1)


def test_the_arrays_of_contact_graspnet_exports_are_documented(tmp_path):
    with np.load(written("contact-graspnet", tmp_path), allow_pickle=False) as arrays:
        types = {name.split("/")[0]: arrays[name].dtype.str for name in arrays.files}
    lines = block("arrays", "export contact-graspnet")
    assert set(types) == keys_of(lines)
    stated = dict(re.findall(r"`(\w+)/S` \([^)]*\) (i4|bool)", lines))
    assert types == {name: TYPES[stated.get(name, "f8")] for name in types}
