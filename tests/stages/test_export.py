"""`export`: our grasps in the formats of other tools, and back."""

import json
import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from pipelines import export
from pipelines.configs import ExportConfig
from pipelines.errors import StaleOutputError, SymgraspError, UnknownNameError, ValueRangeError
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.exports.grasp_exports import folds_case
from pipelines.grasp_files.exports.graspnet_dump import dumped_scenes
from pipelines.grasp_files.grasp_rows import read_grasp_rows
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import GRIPPERS, gripper_digest, load_gripper
from pipelines.grasping.grasps import from_graspnet
from pipelines.storage.array_files import read_npy, read_npz
from pipelines.storage.files import write_json
from pipelines.storage.provenance import make_stamp
from symgrasp_cli.app import app
from tests.grasp_files.exports import export_readers
from tests.grasp_files.whole_file import read_whole
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
    first = read_whole(grasps).results[0].grasps
    assert_allclose(contacts, first.contacts, atol=1e-6)
    assert_allclose(rows[:, 0], first.rank_score)


OUTPUTS = {
    "graspnet": "dump",
    "contact-graspnet": "dump",
    "isaac": "dump",
    "ros-json": "dump",
    "json": "x.json",
    "csv": "x.csv",
}
FAILED = "scenes/scene_0160/realsense/0000"
EMPTY = "scenes/scene_0100/realsense/0001"


def files_of(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize("to", OUTPUTS)
def test_frames_without_grasps_are_exported_and_failed_ones_are_named(to, grasps, tmp_path):
    report = run(grasps, tmp_path / OUTPUTS[to], to=to)
    assert report.exit_code == 1
    assert set(report.failed) == {FAILED}
    assert report.done == [OUTPUTS[to]]
    assert "9 grasps in 4 frames" in report.notes[OUTPUTS[to]]


def test_a_dump_has_a_file_for_each_frame_where_graspnetapi_reads_it(grasps, tmp_path):
    run(grasps, tmp_path / "dump")
    scenes = {scene.scene_id: scene for scene in dumped_scenes(tmp_path / "dump")}
    assert sorted(scenes) == list(SCENES)
    assert scenes[100].frame_ids == [0, 1]
    assert scenes[160].frame_ids == [1]
    assert len(read_grasp_rows(scenes[100].path(1)).rows) == 0
    # A frame outside of a dataset keeps its name.
    assert len(read_grasp_rows(tmp_path / "dump" / "desk" / "0007.npy").rows) == 3


@pytest.mark.parametrize(
    ("to", "file"),
    [
        ("contact-graspnet", "predictions_{}.npz"),
        ("isaac", "{}.yaml"),
        ("ros-json", "{}.json"),
    ],
)
def test_folders_have_a_file_for_each_frame_under_its_name(to, file, grasps, tmp_path):
    run(grasps, tmp_path / "out", to=to)
    assert "{}".join(export.TO_FOLDER[to][1:]) == file
    stems = ["scenes/scene_0100/realsense/0000", EMPTY, "scenes/scene_0160/realsense/0001"]
    paths = [Path(stem) for stem in (*stems, "desk/0007")]
    wanted = {str(path.with_name(file.format(path.name))) for path in paths}
    assert files_of(tmp_path / "out") == wanted | {"provenance.json"}


def test_json_has_every_frame_its_camera_and_how_it_was_made(grasps, tmp_path):
    run(grasps, tmp_path / "x.json", to="json")
    content = json.loads((tmp_path / "x.json").read_text())
    frames = {frame["name"]: frame for frame in content["frames"]}
    assert [frames[name]["status"] for name in (EMPTY, FAILED)] == ["empty", "failed"]
    assert frames[FAILED]["message"] == "no depth"
    assert frames["desk/0007"]["camera"]["fx"] == 300.0
    assert content["infer"]["config"]["gripper"] == content["gripper"]["name"] == "rg2"
    stored = read_whole(grasps).grasps
    found = [grasp for frame in content["frames"] for grasp in frame["grasps"]]
    assert [grasp["grasp"] for grasp in found] == list(range(len(stored)))
    assert_allclose([grasp["contacts"] for grasp in found], stored.contacts, atol=1e-6)


@pytest.fixture
def narrow(tmp_path) -> str:
    """A gripper that holds the box (4 cm), not the can (5 cm) and not the ball (6 cm)."""
    text = (
        (GRIPPERS / "franka.toml").read_text().replace("max_opening = 0.080", "max_opening = 0.056")
    )
    (tmp_path / "narrow.toml").write_text(text.replace('"franka"', '"narrow"'))
    return str(tmp_path / "narrow.toml")


@pytest.mark.parametrize("to", OUTPUTS)
def test_grasps_too_wide_for_a_named_gripper_are_left_out_and_counted(to, narrow, grasps, tmp_path):
    report = run(grasps, tmp_path / OUTPUTS[to], to=to, gripper=narrow)
    assert report.notes["left out"] == (
        "6 of 9 grasps wider than the 44 mm that narrow takes; their places in /grasps: "
        "scenes/scene_0100/realsense/0000 1-2; scenes/scene_0160/realsense/0001 4-5; desk/0007 7-8"
    )
    assert "collisions were checked with rg2" in report.notes[OUTPUTS[to]]


def test_another_gripper_moves_the_base_and_not_the_contacts(grasps, tmp_path):
    found = {}
    for name in ("rg2", "franka"):
        run(grasps, tmp_path / name / "x.json", to="json", gripper=name)
        content = json.loads((tmp_path / name / "x.json").read_text())
        found[name] = content["frames"][0]["grasps"]
    apart = load_gripper("rg2").base_to_contacts - load_gripper("franka").base_to_contacts
    for rg2, franka in zip(found["rg2"], found["franka"], strict=True):
        assert rg2["contacts"] == franka["contacts"]
        poses = np.array(rg2["pose"]), np.array(franka["pose"])
        approach = np.array(rg2["rotation"])[:, 0]
        assert_allclose(poses[1][:3, 3] - poses[0][:3, 3], apart * approach, atol=1e-8)
        assert_allclose(poses[1][:3, :3], poses[0][:3, :3])


def contacts_of(to: str, out: Path, rows: int) -> np.ndarray:
    """Contacts (n, 2, 3) of the first frame of a dataset in an export."""
    gripper, scene = load_gripper("rg2"), "scenes/scene_0100/realsense"
    read, place = {
        "graspnet": (export_readers.graspnet, "scene_0100/realsense/0000.npy"),
        "contact-graspnet": (export_readers.contact_graspnet, f"{scene}/predictions_0000.npz"),
        "isaac": (export_readers.isaac, f"{scene}/0000.yaml"),
        "ros-json": (export_readers.ros_json, f"{scene}/0000.json"),
        "json": (export_readers.whole_json, ""),
        "csv": (export_readers.whole_csv, ""),
    }[to]
    found = read(out, f"{scene}/0000") if not place else read(out / place, gripper)
    assert found.shape == (rows, 2, 3)
    return found[np.lexsort(found[:, 0].T)]


@pytest.mark.parametrize(("tcp", "side"), [("", "behind"), ("tips", "beyond")])
def test_the_report_states_the_side_of_the_contacts_that_the_poses_are_on(
    grasps, tmp_path, tcp, side
):
    report = run(grasps, tmp_path / "x.json", to="json", tcp=tcp)
    assert f"mm {side} the contacts" in "".join(report.notes.values())
    assert "-" not in "".join(report.notes.values())


@pytest.mark.parametrize("to", OUTPUTS)
@pytest.mark.parametrize("tcp", ["", "tips", "contacts", "0.12"])
def test_every_format_gives_poses_of_the_tool_in_the_frame_of_the_robot(to, tcp, grasps, tmp_path):
    T_base_cam = make_pose(random_rotation(np.random.default_rng(1)), [0.4, -0.1, 0.9])
    write_json(tmp_path / "calibration.json", T_base_cam.tolist())
    config = ExportConfig(to=to, tcp=tcp)
    out = tmp_path / OUTPUTS[to]
    export.run(grasps, out, config, camera_to_base=tmp_path / "calibration.json")
    table = read_whole(grasps).results[0].grasps
    expected = transform_points(T_base_cam, table.contacts.astype(float))
    expected = expected[np.lexsort(expected[:, 0].T)]
    assert_allclose(contacts_of(to, out, len(table)), expected, atol=1e-6)


@pytest.mark.parametrize("whole_name", [True, False])
def test_a_camera_on_the_hand_has_a_pose_in_each_frame(whole_name, grasps, tmp_path):
    rng, poses, found = np.random.default_rng(2), tmp_path / "poses", read_whole(grasps).results
    names, ends = [each.name for each in found], [Path(each.name).name for each in found]
    if not whole_name:
        names = [n if ends.count(end) > 1 else end for n, end in zip(names, ends, strict=True)]
        assert "0007" in names
    moved = {name: make_pose(random_rotation(rng), rng.uniform(-1, 1, 3)) for name in names}
    for name, T_base_cam in moved.items():
        write_json(poses / f"{name}.json", T_base_cam.tolist())
    config = ExportConfig(to="json")
    export.run(grasps, tmp_path / "x.json", config, camera_to_base=poses)
    frames = json.loads((tmp_path / "x.json").read_text())["frames"]
    for name, result, frame in zip(names, found, frames, strict=True):
        contacts = result.grasps.contacts[np.argsort(result.grasps.rank_in_frame)].astype(float)
        exported = [grasp["contacts"] for grasp in frame["grasps"]]
        expected = transform_points(moved[name], contacts)
        assert_allclose(np.reshape(exported, (-1, 2, 3)), expected, atol=1e-6)


@pytest.mark.parametrize("camera", ["camera_link", "camera_color_optical_frame"])
@pytest.mark.parametrize("of_each_frame", [False, True])
def test_a_calibration_of_the_cameras_body_is_warned_of_once(
    camera, of_each_frame, grasps, tmp_path, caplog
):
    pose, eye = {"child_frame_id": camera, "T": np.eye(4).tolist()}, tmp_path / "eye.json"
    write_json(eye, pose)
    if of_each_frame:
        eye = tmp_path / "poses"
        for each in read_whole(grasps).results:
            write_json(eye / f"{each.name}.json", pose)
    export.run(grasps, tmp_path / "x.json", ExportConfig(to="json"), camera_to_base=eye)
    command = "tf2_echo camera_link camera_color_optical_frame"
    assert caplog.text.count(command) == (camera == "camera_link")


def test_a_frame_without_a_pose_is_named_and_the_others_are_exported(grasps, tmp_path):
    found = [each.name for each in read_whole(grasps).results if len(each.grasps)]
    for name in found[1:]:
        write_json(tmp_path / "poses" / f"{name}.json", np.eye(4).tolist())
    config, out = ExportConfig(to="ros-json"), tmp_path / "out"
    report = export.run(grasps, out, config, camera_to_base=tmp_path / "poses")
    assert f"has no camera pose for it; give {found[0]}.json" in report.failed[found[0]]
    written = len(read_whole(grasps).results) - len(report.failed)
    assert f"grasps in {written} frames" in report.notes["out"]
    assert not (out / f"{found[0]}.json").exists()
    assert all((out / f"{name}.json").is_file() for name in found[1:])
    write_json(tmp_path / "poses" / f"{found[0]}.json", np.eye(4).tolist())
    with pytest.raises(StaleOutputError):
        export.run(grasps, out, config, camera_to_base=tmp_path / "poses")


def test_frames_that_share_their_last_part_do_not_share_a_camera_pose(grasps, tmp_path):
    found = next(each for each in read_whole(grasps).results if len(each.grasps))
    results = [replace(found, name=name) for name in ("a/7", "b/7", "b/8")]
    source, out = tmp_path / "g.h5", tmp_path / "x.json"
    grasps_file.write(source, results, make_stamp("infer", {"gripper": "rg2"}))
    for name in ("7", "8", "a/7"):
        write_json(tmp_path / "poses" / f"{name}.json", np.eye(4).tolist())
    config = ExportConfig(to="json")
    report = export.run(source, out, config, camera_to_base=tmp_path / "poses")
    assert list(report.failed) == ["b/7"]
    assert report.failed["b/7"].endswith("give b/7.json, as several frames end in 7")
    frames = json.loads(out.read_text())["frames"]
    assert [frame["name"] for frame in frames] == ["a/7", "b/8"]


def test_a_dump_of_poses_at_the_tips_has_no_depth(grasps, tmp_path):
    run(grasps, tmp_path / "dump", to="graspnet", tcp="tips")
    depths = [read_npy(path)[:, 3] for path in (tmp_path / "dump").rglob("*.npy")]
    assert sum(map(len, depths))
    assert not np.concatenate(depths).any()


def test_the_tool_centre_point_is_at_the_chosen_place(grasps, tmp_path):
    gripper, found = load_gripper("rg2"), {}
    for tcp in ("", "tips", "contacts", "0.12"):
        run(grasps, tmp_path / f"x{tcp}.json", to="json", tcp=tcp)
        frame = json.loads((tmp_path / f"x{tcp}.json").read_text())["frames"][0]
        found[tcp] = np.array([grasp["pose"] for grasp in frame["grasps"]])
    along = found[""][:, :3, 2]
    for tcp, metres in (("tips", gripper.flange_to_tip), ("0.12", 0.12)):
        moved = found[""][:, :3, 3] + metres * along
        assert_allclose(found[tcp][:, :3, 3], moved, atol=1e-8)
    middle = [grasp["translation"] for grasp in frame["grasps"]]
    assert_allclose(found["contacts"][:, :3, 3], middle, atol=1e-8)
    with pytest.raises(ValueRangeError, match="tips, contacts, or metres"):
        run(grasps, tmp_path / "y.json", to="json", tcp="wrist")


def test_ros_poses_name_the_base_that_the_calibration_or_the_user_names(grasps, tmp_path):
    eye = tmp_path / "eye.yaml"
    eye.write_text(
        "parameters: {eye_on_hand: false, robot_base_frame: arm_base}\n"
        "transformation: {qw: 1, qx: 0, qy: 0, qz: 0, x: 0, y: 0, z: 1}\n"
    )
    for number, (frame_id, expected) in enumerate((("", "arm_base"), ("world", "world"))):
        config = ExportConfig(to="ros-json", frame_id=frame_id)
        export.run(grasps, tmp_path / str(number), config, camera_to_base=eye)
        found = json.loads((tmp_path / str(number) / "desk" / "0007.json").read_text())
        assert found["pose_array"]["header"]["frame_id"] == expected
        assert expected in found["axes"]
    export.run(
        grasps, tmp_path / "x.json", ExportConfig(to="json", frame_id="hall"), camera_to_base=eye
    )
    assert "hall" in (tmp_path / "x.json").read_text()
    for to, base in (("graspnet", eye), ("json", None)):
        config = ExportConfig(to=to, frame_id="hall")
        with pytest.raises(ValueRangeError, match=rf"--frame-id .* {to} does not name the frame"):
            export.run(grasps, tmp_path / OUTPUTS[to], config, camera_to_base=base)


def test_contact_graspnet_has_its_own_origin_unless_a_gripper_is_named(grasps, tmp_path):
    for name, base in (("", 0.1034), ("rg2", load_gripper("rg2").base_to_contacts)):
        run(grasps, tmp_path / f"out{name}", to="contact-graspnet", gripper=name)
        arrays = read_npz(tmp_path / f"out{name}" / "desk" / "predictions_0007.npz")
        assert_allclose(arrays["base_to_contacts"], base)


@pytest.mark.parametrize("to", OUTPUTS)
def test_frames_that_could_not_be_exported_are_named_again(to, grasps, tmp_path):
    first, second = (run(grasps, tmp_path / OUTPUTS[to], to=to) for _ in range(2))
    assert second.skipped
    assert second.failed == first.failed
    assert (first.exit_code, second.exit_code) == (1, 1)


@pytest.fixture
def own_gripper(tmp_path, monkeypatch) -> Path:
    """A gripper's file, given by its name in the working folder."""
    monkeypatch.chdir(tmp_path)
    text = (GRIPPERS / "rg2.toml").read_text().replace("rg2", "mine")
    Path("hand.toml").write_text(text)
    return Path("hand.toml")


def own_grasps(root_grasps: Path, own_gripper: Path) -> Path:
    """Write grasps of a run with `own_gripper`."""
    path = own_gripper.resolve().with_name("own.h5")
    results = list(read_whole(root_grasps).results)
    inputs = {"gripper": gripper_digest(str(own_gripper))}
    stamp = make_stamp("infer", {"gripper": str(own_gripper)}, inputs=inputs)
    grasps_file.write(path, results, stamp)
    return path


def test_a_gripper_file_that_has_changed_since_is_refused(
    grasps, own_gripper, tmp_path, monkeypatch
):
    own = own_grasps(grasps, own_gripper)
    notes = run(own, tmp_path / "same.json", to="json").notes["same.json"]
    assert "gripper mine" in notes
    assert "collisions were checked" not in notes
    copy = tmp_path / "copy.toml"
    copy.write_text(own_gripper.read_text())
    notes = run(own, tmp_path / "copied.json", to="json", gripper=str(copy)).notes["copied.json"]
    assert "collisions were checked" not in notes
    own_gripper.write_text(own_gripper.read_text().replace("0.11", "0.09"))
    with pytest.raises(SymgraspError, match=r"hand\.toml.* has other measures now; name a"):
        run(own, tmp_path / "new.json", to="json")
    notes = run(own, tmp_path / "new.json", to="json", gripper="hand.toml").notes["new.json"]
    assert "collisions were checked with hand.toml, not with mine" in notes
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(SymgraspError, match=r"hand\.toml.* no longer exists .*name a --grip"):
        run(own, tmp_path / "away.json", to="json")
    assert run(own, tmp_path / "away.json", to="json", gripper=str(copy)).done


@pytest.mark.parametrize("to", OUTPUTS)
def test_an_export_is_skipped_when_done_and_refused_when_it_differs(to, grasps, tmp_path):
    out = tmp_path / OUTPUTS[to]
    run(grasps, out, to=to)
    assert run(grasps, out, to=to).skipped
    with pytest.raises(StaleOutputError):
        run(grasps, out, to=to, gripper="franka")
    made = export.run(grasps, out, ExportConfig(to=to, gripper="franka"), overwrite=True)
    assert made.done
    if out.is_dir():
        lost = next(path for path in out.rglob("*") if path.is_file() and path.stem != "provenance")
        before = lost.read_bytes()
        lost.unlink()
        assert run(grasps, out, to=to, gripper="franka").done
        assert lost.read_bytes() == before
    assert run(grasps, out, to=to, gripper="franka").skipped


def test_a_folder_or_file_with_other_content_is_not_replaced(grasps, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine.json").write_text('{"a": 1}')
    (tmp_path / "mine.csv").write_text("a,b\n")
    for name, to in (("mine", "graspnet"), ("mine.json", "json"), ("mine.csv", "csv")):
        with pytest.raises(SymgraspError, match="no output of export"):
            export.run(grasps, tmp_path / name, ExportConfig(to=to), overwrite=True)
    assert files_of(tmp_path) == {"mine.json", "mine.csv"}
    assert (tmp_path / "mine").is_dir()


def test_a_table_whose_stamp_was_never_written_is_made_again(grasps, tmp_path):
    run(grasps, tmp_path / "x.csv", to="csv")
    (tmp_path / "x.csv.provenance.json").unlink()  # as after a kill between the two
    with pytest.raises(StaleOutputError):
        run(grasps, tmp_path / "x.csv", to="csv")
    assert export.run(grasps, tmp_path / "x.csv", ExportConfig(to="csv"), overwrite=True).done


def test_the_stamp_of_one_table_is_never_left_with_another(grasps, tmp_path, monkeypatch):
    run(grasps, tmp_path / "x.csv", to="csv")

    def killed(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(export, "write_sidecar", killed)
    config = ExportConfig(to="csv", gripper="franka")
    with pytest.raises(KeyboardInterrupt):
        export.run(grasps, tmp_path / "x.csv", config, overwrite=True)
    with pytest.raises(StaleOutputError):  # not "skipped as finished"
        run(grasps, tmp_path / "x.csv", to="csv")


def test_files_and_folders_are_not_taken_for_each_other(grasps, tmp_path):
    with pytest.raises(SymgraspError, match=r"ends in \.json"):
        run(grasps, tmp_path / "out", to="json")
    run(grasps, tmp_path / "x.json", to="json")
    with pytest.raises(SymgraspError, match="written as a folder"):
        export.run(grasps, tmp_path / "x.json", ExportConfig(to="ros-json"), overwrite=True)
    (tmp_path / "y.csv").mkdir()
    with pytest.raises(SymgraspError, match=r"ends in \.csv"):
        run(grasps, tmp_path / "y.csv", to="csv")


@pytest.mark.parametrize(("to", "name"), [("graspnet", "g.json"), ("ros-json", "poses.JSON")])
def test_a_folder_is_not_named_like_a_file(to, name, grasps, tmp_path):
    with pytest.raises(SymgraspError, match=f"--to {to} writes a folder") as refused:
        run(grasps, tmp_path / name, to=to)
    assert refused.value.exit_code == 2
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize("to", OUTPUTS)
def test_nothing_is_written_if_no_frame_can_be(to, tmp_path):
    write_grasps(tmp_path / "g.h5", [FrameResult("a", "failed", "no depth")])
    with pytest.raises(SymgraspError, match=r"none of 1 frame can be exported.*no depth"):
        run(tmp_path / "g.h5", tmp_path / OUTPUTS[to], to=to)
    assert files_of(tmp_path) == {"g.h5"}


@pytest.mark.parametrize("to", OUTPUTS)
def test_a_file_of_frames_without_grasps_is_exported(to, tmp_path):
    write_grasps(tmp_path / "g.h5", [FrameResult("a", "empty"), FrameResult("b", "empty")])
    report = run(tmp_path / "g.h5", tmp_path / OUTPUTS[to], to=to)
    assert (report.exit_code, report.done) == (0, [OUTPUTS[to]])


def test_a_frame_whose_name_leads_outside_or_is_too_long_fails_alone(grasps, tmp_path):
    (good, *_) = read_whole(grasps).results
    names = ("../evil", "n" * 240, "good")
    write_grasps(tmp_path / "g.h5", [replace(good, name=name) for name in names])
    report = run(tmp_path / "g.h5", tmp_path / "out", to="isaac")
    assert set(report.failed) == {"../evil", "n" * 240}
    assert files_of(tmp_path) == {"g.h5", "out/good.yaml", "out/provenance.json"}


@pytest.mark.parametrize("to", OUTPUTS)
def test_a_damaged_frame_is_named_and_the_others_are_exported(to, grasps, tmp_path):
    several = named(grasps, tmp_path / "g.h5", "a", "b", "c")
    out, whole = tmp_path / OUTPUTS[to], tmp_path / "whole.json"
    run(several, whole, to="json")
    with h5py.File(several, "r+") as file:
        file["grasps/region"][4] = 99  # of the second frame
    report = run(several, out, to=to)
    assert "is damaged (region of a grasp" in report.failed.pop("b")
    assert not report.failed
    assert "6 grasps in 2 frames" in report.notes[out.name]
    if to == "json":
        frames = [json.loads(path.read_text())["frames"] for path in (whole, out)]
        assert frames[1] == [frames[0][0], frames[0][2]]


@pytest.mark.parametrize("signature", [b"TREE", b"SNOD", b"HEAP", b"GCOL", b'{"config"'])
def test_a_damaged_file_is_reported_in_one_sentence_and_leaves_nothing(signature, grasps, tmp_path):
    data = grasps.read_bytes()
    places = [match.start() for match in re.finditer(re.escape(signature), data)]
    assert places
    for place in places:
        damaged = data[:place] + b"XXXX" + data[place + 4 :]
        (tmp_path / "g.h5").write_bytes(damaged)
        for to, out in (("json", "x.json"), ("isaac", "out")):
            with pytest.raises(SymgraspError):
                run(tmp_path / "g.h5", tmp_path / out, to=to)
    assert files_of(tmp_path) == {"g.h5"}


def test_an_unknown_format_is_named(grasps, tmp_path):
    with pytest.raises(UnknownNameError, match="contact-graspnet, csv, graspnet, isaac"):
        run(grasps, tmp_path / "dump", to="moveit")


def test_the_command_exports_grasps(grasps, tmp_path):
    result = CliRunner().invoke(app, ["export", str(grasps), "--out", str(tmp_path / "dump")])
    assert result.exit_code == 1  # a failed frame is among them
    assert np.load(tmp_path / "dump" / "scene_0100" / "realsense" / "0000.npy").shape == (3, 17)


def named(grasps: Path, path: Path, *names: str) -> Path:
    """Write the grasps of the first frame under several names; return the file."""
    (first, *_) = read_whole(grasps).results
    write_grasps(path, [replace(first, name=name) for name in names])
    return path


TWO_ROOTS = tuple(f"{root}/scenes/scene_0100/realsense/0000" for root in "ab")


def test_frames_of_several_roots_do_not_replace_each_other(grasps, tmp_path):
    others = ("b/scenes/scene_0101/realsense/0003", "desk/7")
    several = named(grasps, tmp_path / "g.h5", *TWO_ROOTS, *others)
    report = run(several, tmp_path / "dump")
    assert (report.exit_code, "12 grasps in 4" in report.notes["dump"]) == (0, True)
    assert f"{TWO_ROOTS[0]} and {TWO_ROOTS[1]}" in report.notes["names"]
    files = files_of(tmp_path / "dump") - {"provenance.json"}
    assert files == {f"{name}.npy" for name in (*TWO_ROOTS, *others)}
    scenes = dumped_scenes(tmp_path / "dump" / "b" / "scenes")
    assert [scene.scene_id for scene in scenes] == [100, 101]
    with pytest.raises(SymgraspError, match="folder a/scenes in it holds scenes"):
        dumped_scenes(tmp_path / "dump")


def test_frames_of_several_roots_with_different_scenes_give_one_dump(grasps, tmp_path):
    names = (TWO_ROOTS[0], "b/scenes/scene_0101/realsense/0000")
    report = run(named(grasps, tmp_path / "g.h5", *names), tmp_path / "dump")
    assert "names" not in report.notes
    assert [scene.scene_id for scene in dumped_scenes(tmp_path / "dump")] == [100, 101]


TAKEN = [
    ("ros-json", "provenance", "the export's stamp"),
    ("ros-json", "a.json/b", "that of a"),
    ("isaac", "a.yaml/b", "that of a"),
    ("graspnet", "provenance.json/b", "the export's stamp"),
]


@pytest.mark.parametrize(("to", "name", "owner"), TAKEN)
def test_a_frame_whose_file_belongs_to_another_frame_fails_alone_and_is_named_again(
    to, name, owner, grasps, tmp_path
):
    odd = named(grasps, tmp_path / "g.h5", "a", name)
    first, second = (run(odd, tmp_path / "out", to=to) for _ in range(2))
    assert list(first.failed) == [name]
    assert f"would replace {owner}" in first.failed[name]
    assert "3 grasps in 1 frame;" in first.notes["out"]
    assert (second.failed, second.skipped) == (first.failed, ["out"])
    assert json.loads((tmp_path / "out" / "provenance.json").read_text())["stage"] == "export"


def test_a_file_at_the_place_of_a_folder_fails_alone(grasps, tmp_path):
    odd = named(grasps, tmp_path / "g.h5", "a.yaml/b", "a")
    report = run(odd, tmp_path / "out", to="isaac")
    assert "a.yaml is a folder of other frames" in report.failed["a"]


@pytest.mark.parametrize("folds", [True, False])
@pytest.mark.parametrize("to", [to for to, out in OUTPUTS.items() if out == "dump"])
def test_names_that_differ_only_in_case_collide_only_where_the_disk_ignores_case(
    folds, to, grasps, tmp_path, monkeypatch
):
    monkeypatch.setattr(export, "folds_case", lambda _folder: folds)
    report = run(named(grasps, tmp_path / "g.h5", "box/a", "Box/A"), tmp_path / "out", to=to)
    assert list(report.failed) == (["Box/A"] if folds else [])


def test_an_ordinary_disk_distinguishes_case(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "OUT").mkdir()
    assert not folds_case(tmp_path / "out" / "new")
    (tmp_path / "OUT").rmdir()
    (tmp_path / "OUT").symlink_to(tmp_path / "out")  # as on a disk that ignores case
    assert folds_case(tmp_path / "out" / "new")
