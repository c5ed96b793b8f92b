"""Recordings for rerun, through a stand-in; and the error sentence without rerun."""

import errno
import os
import sys
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.errors import SymgraspError, WriteError
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.pictures import rerun_recording
from pipelines.pictures.rerun_recording import need_rerun, write_recording
from pipelines.storage.provenance import make_stamp, read_stamp
from tests.pictures.grasp_page.toys import toy_frame, toy_result

STAMP = make_stamp("view", {})
FRAME, INDEX = toy_frame("a")
RESULT = toy_result(FRAME, INDEX)
GRIPPER = load_gripper("rg2")


class Stream:
    logged: ClassVar[dict] = {}
    ids: ClassVar[list[str]] = []

    def __init__(self, application_id, recording_id):
        self.logged.clear()
        self.ids.append(recording_id)

    def memory_recording(self):
        return SimpleNamespace(drain_as_bytes=lambda: b"RRD")

    def log(self, path, entity, static):
        self.logged[path] = entity

    def disconnect(self):
        pass


@pytest.fixture
def rerun(monkeypatch):
    def made(*given, **named):
        return SimpleNamespace(given=given, **named, compress=lambda: named)

    names = ("Points3D", "Pinhole", "Image", "LineStrips3D", "Boxes3D")
    stand_in = SimpleNamespace(
        RecordingStream=Stream, ViewCoordinates=SimpleNamespace(RDF=0), **dict.fromkeys(names, made)
    )
    monkeypatch.setitem(sys.modules, "rerun", stand_in)


@pytest.fixture
def logged(rerun, tmp_path):
    write_recording(tmp_path / "a.rrd", FRAME, RESULT, GRIPPER, STAMP)
    assert (tmp_path / "a.rrd").read_bytes() == b"RRD"
    assert read_stamp(tmp_path / "a.rrd") == STAMP.as_json()
    return Stream.logged


@pytest.mark.usefixtures("rerun")
def test_recordings_of_a_frame_from_two_runs_are_not_merged_by_the_viewer(tmp_path):
    Stream.ids.clear()
    for grasps in ("first", "first", "second"):
        stamp = make_stamp("view", {}, inputs={"grasps": grasps})
        write_recording(tmp_path / "a.rrd", FRAME, RESULT, GRIPPER, stamp)
    first, again, second = Stream.ids
    assert first == again
    assert first != second


def rotated(quaternion, vector):
    """A vector turned by a quaternion x, y, z, w."""
    axis, w = quaternion[:3], quaternion[3]
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)


def test_hands_are_drawn_as_the_boxes_of_the_gripper(logged):
    table, best = RESULT.grasps, logged["world/grasps/place_00"]
    rows = np.flatnonzero(table.is_best)
    assert len(best.centers) == 3 * len(rows)
    for i, row in enumerate(rows):
        for part, (low, high) in enumerate(GRIPPER.boxes(table.width[row])):
            k = 3 * i + part
            for corner, sign in ((low, -1), (high, 1)):
                drawn = best.centers[k] + rotated(best.quaternions[k], sign * best.half_sizes[k])
                wanted = table.rotation[row] @ corner + table.translation[row]
                assert_allclose(drawn, wanted, atol=1e-6)


def test_every_grasp_and_every_trusted_symmetry_is_there_once(logged):
    places = [path for path in logged if path.count("/") == 2 and "grasps" in path]
    assert sum(len(logged[path].centers) for path in places) == 3 * len(RESULT.grasps)
    assert {path.split("symmetries/")[1] for path in logged if "symmetries" in path} == {
        "region_0/plane_0", "region_0/axis_3", "region_0/sphere_4", "region_1/plane_2"
    }  # fmt: skip
    assert len(logged["world/points"].given[0]) == (FRAME.depth > 0).sum()


@pytest.mark.usefixtures("rerun")
def test_a_recording_on_a_full_disk_is_an_error_and_leaves_no_recording(monkeypatch, tmp_path):
    def full(_handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteError, match=r"a\.rrd.* cannot be written"):
        write_recording(tmp_path / "a.rrd", FRAME, RESULT, GRIPPER, STAMP)
    assert not (tmp_path / "a.rrd").exists()


@pytest.mark.usefixtures("rerun")
def test_a_recording_that_a_killed_run_has_left_has_its_stamp(monkeypatch, tmp_path):
    def killed(path, _content):
        assert read_stamp(path) == STAMP.as_json()
        raise KeyboardInterrupt

    (tmp_path / "a.rrd").write_bytes(b"an earlier one")
    monkeypatch.setattr(rerun_recording, "write_bytes", killed)
    with pytest.raises(KeyboardInterrupt):
        write_recording(tmp_path / "a.rrd", FRAME, RESULT, GRIPPER, STAMP)
    assert not (tmp_path / "a.rrd").exists()


def test_a_missing_rerun_is_reported_with_the_way_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(SymgraspError, match="pip install"):
        need_rerun()
