"""`export`: grasps of ours as dumps, and back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from pipelines import export
from pipelines.configs import ExportConfig
from pipelines.errors import StaleOutputError, SymgraspError, UnknownNameError
from pipelines.formats import grasps_file
from pipelines.formats.grasp_rows import read_grasp_rows
from pipelines.formats.graspnet_dump import dumped_scenes
from pipelines.formats.grasps_file import FrameResult
from pipelines.formats.gripper_files import load_gripper
from pipelines.grasping.grasps import from_graspnet
from symgrasp_cli.app import app
from tests.stages.toy_root import SCENES, frame_names, true_result, write_grasps, write_root


@pytest.fixture(scope="module")
def grasps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grasps")
    root = write_root(folder / "root")
    results = [true_result(root, name) for name in frame_names()]
    results[1] = FrameResult(results[1].name, "empty")
    results[2] = FrameResult(results[2].name, "failed", "no depth")
    results.append(replace(results[0], name="desk/0007"))
    write_grasps(folder / "grasps.h5", results)
    return folder / "grasps.h5"


def run(grasps: Path, out: Path, **options):
    return export.run(grasps, out, ExportConfig(**options))


def test_the_contacts_come_back_to_the_micrometre(grasps, tmp_path):
    run(grasps, tmp_path / "dump")
    gripper = load_gripper("rg2")
    rows = read_grasp_rows(tmp_path / "dump" / "scene_0100" / "realsense" / "0000.npy").rows
    back = from_graspnet(rows, tip_reach=gripper.tip_reach)
    contacts = replace(back, width=back.width - 2.0 * gripper.clearance).contacts
    first = grasps_file.read(grasps).results()[0].grasps
    assert_allclose(contacts, first.contacts, atol=1e-6)
    assert_allclose(rows[:, 0], first.rank_score)


def test_frames_without_grasps_are_empty_and_failed_or_foreign_ones_are_named(grasps, tmp_path):
    report = run(grasps, tmp_path / "dump")
    assert report.exit_code == 1
    assert set(report.failed) == {"scenes/scene_0160/realsense/0000", "desk/0007"}
    scenes = {scene.scene_id: scene for scene in dumped_scenes(tmp_path / "dump")}
    assert sorted(scenes) == list(SCENES)
    assert scenes[100].frame_ids == [0, 1]
    assert scenes[160].frame_ids == [1]
    assert len(read_grasp_rows(scenes[100].path(1)).rows) == 0


def test_an_export_is_skipped_when_done_and_refused_when_it_differs(grasps, tmp_path):
    run(grasps, tmp_path / "dump")
    assert run(grasps, tmp_path / "dump").skipped
    with pytest.raises(StaleOutputError):
        run(grasps, tmp_path / "dump", gripper="franka")


def test_a_folder_of_other_things_is_not_replaced(grasps, tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(SymgraspError):
        export.run(grasps, tmp_path / "mine", ExportConfig(), overwrite=True)
    assert (tmp_path / "mine").is_dir()


def test_an_unknown_format_is_named(grasps, tmp_path):
    with pytest.raises(UnknownNameError, match="graspnet"):
        run(grasps, tmp_path / "dump", to="ros")


def test_the_command(grasps, tmp_path):
    result = CliRunner().invoke(app, ["export", str(grasps), "--out", str(tmp_path / "dump")])
    assert result.exit_code == 1  # a failed frame is among them
    assert np.load(tmp_path / "dump" / "scene_0100" / "realsense" / "0000.npy").shape == (3, 17)
