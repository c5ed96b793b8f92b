"""`workspace`: a box that `infer` takes, and a picture of it."""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import workspace
from pipelines.configs import InferConfig, LimitsConfig, WorkspaceConfig
from pipelines.errors import StaleOutputError, SymgraspError
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.workspace_files import parse_workspace
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.models import WEIGHTS
from pipelines.storage.files import read_json
from pipelines.storage.images import read_image, write_image
from symgrasp_cli.app import app
from tests.stages.toy_root import write_root

FRAMES = WEIGHTS / "frames"
ONE = WorkspaceConfig(max_frames=1)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workspace") / "out"
    return folder, workspace.run(FRAMES, folder, ONE)


def planned(**limits):
    """The frame's planar grasps within limits."""
    config = InferConfig(regions="geometric", method="planar", limits=LimitsConfig(**limits))
    frame = find_frames(FRAMES)[0].read()
    return Planner(config, load_gripper("rg2")).plan(frame, np.random.default_rng(0))


def test_infer_takes_the_printed_box_and_keeps_every_region(found):
    _, result = found
    option, _, frame = result.options().rpartition(" --workspace-frame ")
    box = parse_workspace(option.removeprefix("--workspace="))[0]
    assert frame == "table"
    assert len(planned(box=box, box_frame=frame).regions) == len(planned().regions) > 0


def test_a_frame_for_the_box_is_refused_without_a_box(tmp_path):
    config = WorkspaceConfig(box_frame="camera")
    with pytest.raises(SymgraspError, match="--workspace-frame is camera") as refused:
        workspace.run(FRAMES, tmp_path / "out", config)
    assert refused.value.exit_code == 2


def test_the_picture_is_dark_outside_and_the_mask_is_black(found):
    folder, _ = found
    picture, mask = (read_image(folder / f"table_1{end}.png") for end in ("", "_mask"))
    color = find_frames(FRAMES)[0].read().color
    assert picture.shape == color.shape
    assert 0 < (mask == 0).mean() < 1
    assert picture[mask == 0].mean() < 0.8 * color[mask == 0].mean()


def test_the_mask_is_of_the_pixels_of_the_files_of_a_camera_with_lens_distortion(tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    for end in ("color.png", "depth.png"):
        shutil.copy(FRAMES / f"table_1_{end}", frames)
    camera = read_json(FRAMES / "table_1_camera.json") | {"D": [-0.28, 0.07]}
    (frames / "table_1_camera.json").write_text(json.dumps(camera))
    box = (-0.1, -0.1, 0.5, 0.1, 0.1, 1.5)
    config = WorkspaceConfig(box=box, box_frame="camera")
    workspace.run(frames, tmp_path / "w", config)
    frame = find_frames(frames)[0].read()
    assert frame.removed is not None
    points = frame.intrinsics.backproject(frame.depth)
    inside = ((points >= box[:3]) & (points <= box[3:])).all(axis=-1)
    shown = frame.undistorted(read_image(tmp_path / "w/table_1_mask.png")) > 0
    measured = frame.depth > 0
    assert inside.any()
    assert np.mean(shown[measured] == inside[measured]) > 0.999


def test_a_box_that_is_given_is_drawn_instead_and_frames_may_be_printed(tmp_path):
    given = ["--workspace", "-0.1,0.2,0,0.1,0.4,0.3", "--max-frames", "1", "--json"]
    out = CliRunner().invoke(app, ["workspace", str(FRAMES), "--out", str(tmp_path / "w"), *given])
    assert out.exit_code == 0, out.output
    printed = json.loads(out.stdout.splitlines()[0])
    assert (
        printed["options"] == "--workspace=-0.10,0.20,0.00,0.10,0.40,0.30 --workspace-frame table"
    )
    assert printed["boxes"]["table_1"]["corners"] == [[-0.1, 0.2, 0.0], [0.1, 0.4, 0.3]]


def test_a_second_run_returns_the_boxes_and_leaves_masks_that_were_painted(tmp_path):
    folder = tmp_path / "out"
    first = workspace.run(FRAMES, folder, ONE)
    (folder / "table_1_mask.png").write_bytes(b"painted")
    assert workspace.run(FRAMES, folder, ONE).options() == first.options()
    assert (folder / "table_1_mask.png").read_bytes() == b"painted"
    drawn = (folder / "table_1.png").read_bytes()
    (folder / "table_1.png").unlink()
    workspace.run(FRAMES, folder, ONE)
    assert (folder / "table_1.png").read_bytes() == drawn
    assert (folder / "table_1_mask.png").read_bytes() == b"painted"


def test_pictures_of_other_images_or_of_another_stated_unit_are_not_kept(tmp_path):
    frames = write_root(tmp_path / "root").root / "scenes/scene_0100/realsense"
    config = WorkspaceConfig(max_frames=1, box=(-0.1, -0.1, 0.3, 0.1, 0.1, 0.9), box_frame="camera")
    workspace.run(frames, tmp_path / "w", config)
    halved = FrameOptions(depth_units_per_metre=2000.0)
    with pytest.raises(StaleOutputError):
        workspace.run(frames, tmp_path / "w", config, stated=halved)
    workspace.run(frames, tmp_path / "w", config)
    color = frames / "rgb/0000.png"  # its depth has the same name in another folder
    write_image(color, read_image(color) + 1)
    with pytest.raises(StaleOutputError):
        workspace.run(frames, tmp_path / "w", config)


def test_a_file_that_is_lost_after_the_search_fails_its_frame_alone(tmp_path, monkeypatch):
    shutil.copytree(FRAMES, tmp_path / "in")
    sources = find_frames(tmp_path / "in")[:2]
    sources[0].files[1].unlink()
    monkeypatch.setattr(workspace, "find_frames", lambda *_arguments: sources)
    result = workspace.run(tmp_path / "in", tmp_path / "out", WorkspaceConfig())
    assert list(result.report.failed) == [sources[0].name]


def test_a_folder_with_other_content_is_not_replaced(tmp_path):
    (tmp_path / "mine.txt").write_text("x")
    with pytest.raises(SymgraspError, match="no output of workspace; choose another"):
        workspace.run(FRAMES, tmp_path, ONE)


def test_regions_outside_of_a_workspace_are_reported_with_their_place():
    message = planned(box=(5.0, 5.0, 5.0, 6.0, 6.0, 6.0)).message
    assert "is in the workspace; their middles are at x " in message
    assert "m in the camera frame" in message
