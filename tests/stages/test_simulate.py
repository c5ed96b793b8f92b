"""`simulate` on a dataset whose best grasps are known."""

import hashlib
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import evaluate, simulate
from pipelines.configs import EvaluateConfig, SimulateConfig
from pipelines.dataset import convex_pieces
from pipelines.dataset.graspnet.graspnet import GraspNetRoot, write_label
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.errors import FormatError, StaleOutputError, SymgraspError, UnknownNameError
from pipelines.evaluation.rows import BASELINE_ROWS
from pipelines.evaluation.runs.trial_records import read_trials
from pipelines.frames.graspnet_scene import ObjectPose, write_annotation, write_meta
from pipelines.geometry.meshes import convex_decomposition
from pipelines.geometry.transforms import invert, make_pose
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasping.grasps import GraspPoses
from pipelines.runtime.batch import BatchOptions, StageReport
from pipelines.storage.files import read_json
from symgrasp_cli.app import app
from tests.geometry.meshes.test_convex_decomposition import tray
from tests.stages.toy_root import (
    CAMERA,
    DOWN,
    SCENES,
    STAMP,
    camera_in_table,
    frame_names,
    grasp_table,
    poses_in_camera,
    true_result,
    write_grasps,
    write_root,
)

KINDS = {0: "reflection", 1: "rotation", 2: "sphere"}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> GraspNetRoot:
    return write_root(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def truth_file(root: GraspNetRoot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("truth") / "grasps.h5"
    write_grasps(path, [true_result(root, name) for name in frame_names()])
    return path


@pytest.fixture(scope="module")
def small_file(root: GraspNetRoot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One frame of each scene with one grasp."""
    path = tmp_path_factory.mktemp("small") / "grasps.h5"
    write_grasps(path, [true_result(root, name, (1,)) for name in frame_names()[::2]])
    return path


def run(grasps: Path, root: GraspNetRoot, output: Path, **options) -> StageReport:
    config = SimulateConfig(
        frictions=options.pop("frictions", (0.5,)),
        min_visible_pixels=100,
        gripper=options.pop("gripper", ""),
    )
    seed, baselines = options.pop("seed", 0), options.pop("baselines", False)
    batch = BatchOptions(progress=False, **options)
    return simulate.run(grasps, root.root, output, config, batch, baselines=baselines, seed=seed)


def content_of(folder: Path) -> dict[str, str]:
    """Digest of every file below a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def truth_success(root, truth_file, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("success") / "success.json"
    assert run(truth_file, root, output, frictions=(0.05, 0.3, 0.8)).exit_code == 0
    return output


@pytest.fixture(scope="module")
def truth_small(root, small_file, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("small") / "success.json"
    run(small_file, root, output)
    return output


def test_true_grasps_hold_and_slippery_fingers_do_not(truth_success):
    rates = read_json(truth_success)["success"]["all"]["all"]
    assert [(rates[f]["held"], rates[f]["trials"]) for f in ("0.05", "0.3", "0.8")] == [
        (0, 12), (12, 12), (12, 12),
    ]  # fmt: skip


def test_trials_count_with_the_symmetry_of_their_region_and_in_their_split(truth_success):
    success = read_json(truth_success)["success"]
    assert list(success) == ["seen", "novel", "all"]
    for kinds in (success["seen"], success["novel"]):
        trials = {kind: cell["0.3"]["trials"] for kind, cell in kinds.items()}
        assert trials == {"reflection": 2, "rotation": 2, "sphere": 2, "none": 0, "all": 6}


def test_every_trial_is_recorded(truth_success):
    folder = simulate.trials_folder(truth_success)
    frames = [frame for path in sorted(folder.iterdir()) for frame in read_trials(path)]
    assert [frame.name for frame in frames] == frame_names()
    for frame in frames:
        assert {trial.object_id: trial.kind for trial in frame.trials} == KINDS
        assert all(list(trial.outcomes) == ["0.05", "0.3", "0.8"] for trial in frame.trials)


def test_the_tables_show_rates_with_intervals_and_reasons(truth_success):
    rates, reasons = simulate.tables(truth_success)
    assert rates.rows[-1] == (
        "all",
        "all",
        "12",
        "0 [0-24]",
        "100 [76-100]",
        "100 [76-100]",
    )
    assert reasons.rows[-1] == ("all", "0.8", "0", "12")


@pytest.fixture(scope="module")
def with_baselines(root, small_file, tmp_path_factory) -> Path:
    """Rates of other methods in addition to ours; the dataset is only read."""
    before = content_of(root.root)
    output = tmp_path_factory.mktemp("baselines") / "success.json"
    assert run(small_file, root, output, baselines=True).exit_code == 0
    assert content_of(root.root) == before
    return output


def test_two_workers_write_the_same_bytes_and_the_dataset_is_only_read(
    root, small_file, with_baselines, tmp_path
):
    before = content_of(root.root)
    run(small_file, root, tmp_path / "success.json", baselines=True, workers=2)
    assert content_of(tmp_path) == content_of(with_baselines.parent)
    assert content_of(root.root) == before


def test_other_methods_are_tried_in_addition_and_our_rates_do_not_change(
    truth_small, with_baselines
):
    alone, beside = read_json(truth_small), read_json(with_baselines)
    assert alone["baselines"] == {}
    assert (beside["success"], beside["reasons"]) == (alone["success"], alone["reasons"])
    assert list(beside["baselines"]) == list(BASELINE_ROWS)
    held = {
        row: found["success"]["all"]["rotation"]["0.5"]["held"]
        for row, found in beside["baselines"].items()
    }
    assert held["oracle"] == 2  # true symmetries of a can give grasps that hold it
    assert all(found["success"]["all"]["all"]["0.5"]["trials"] == 6
               for found in beside["baselines"].values())  # fmt: skip


def test_trials_and_evaluate_use_the_same_grasps(root, small_file, with_baselines, tmp_path):
    config = EvaluateConfig(min_visible_pixels=100)
    options = BatchOptions(progress=False)
    evaluate.run(small_file, root.root, tmp_path / "report.json", config, options, baselines=True)
    judged = read_json(tmp_path / "report.json")["rows"]
    simulated = read_json(with_baselines)
    for row, found in {"ours": simulated, **simulated["baselines"]}.items():
        reasons = judged[row]["all"]["reasons"]
        without = reasons.get("no region", 0) + reasons.get("no grasp", 0)
        assert found["reasons"]["all"]["0.5"]["no grasp"] == without


def test_rates_without_other_methods_are_replaced_only_on_request(root, small_file, tmp_path):
    run(small_file, root, tmp_path / "success.json")
    with pytest.raises(StaleOutputError, match="--overwrite"):
        run(small_file, root, tmp_path / "success.json", baselines=True)


def test_an_oracle_without_affordance_is_refused_with_the_command_that_makes_it(
    small_file, tmp_path
):
    own = write_root(tmp_path / "root")
    for object_id in KINDS:
        own.affordance_path(object_id).unlink()
    report = run(small_file, own, tmp_path / "success.json", baselines=True)
    assert len(report.failed) == len(SCENES)
    assert all("symgrasp refine-grasps" in sentence for sentence in report.failed.values())


KILLED = """
import os, signal, sys
from pathlib import Path
from pipelines import evaluate, simulate
from pipelines.runtime.batch import BatchOptions
from pipelines.configs import SimulateConfig

write, written = simulate.{function}, []

def write_then_die(*arguments):
    if written:
        os.kill(os.getpid(), signal.SIGKILL)
    write(*arguments)
    written.append(1)

simulate.{function} = write_then_die
config = SimulateConfig(frictions=(0.5,), min_visible_pixels=100)
paths = [Path(argument) for argument in sys.argv[1:]]
simulate.run(*paths, config, BatchOptions(progress=False))
"""


def test_a_killed_run_goes_on_where_it_was_and_gives_the_same_bytes(
    root, small_file, truth_small, tmp_path
):
    output = tmp_path / "success.json"
    script = KILLED.format(function="write_trials")
    command = [sys.executable, "-c", script, str(small_file), str(root.root), str(output)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    assert not output.exists()
    report = run(small_file, root, output)
    assert (len(report.skipped), len(report.done)) == (len(KINDS) + 1, len(SCENES) - 1)
    assert content_of(tmp_path) == content_of(truth_small.parent)


def test_a_second_run_tries_nothing_again_and_a_resumed_run_only_the_rest(
    root, small_file, truth_small, tmp_path
):
    output = shutil.copytree(truth_small.parent, tmp_path, dirs_exist_ok=True) / truth_small.name
    whole = content_of(tmp_path)
    assert run(small_file, root, output).done == []
    records = sorted(simulate.trials_folder(output).iterdir())
    records[0].unlink()
    output.unlink()
    assert run(small_file, root, output).done == [records[0].stem]
    assert content_of(tmp_path) == whole


def test_a_file_of_another_program_is_not_replaced_even_on_request(root, small_file, tmp_path):
    (tmp_path / "settings.json").write_text('{"mine": 1}')
    with pytest.raises(SymgraspError, match="is no output of simulate"):
        run(small_file, root, tmp_path / "settings.json", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["settings.json"]


def test_rates_of_other_grasps_are_replaced_only_on_request(
    root, small_file, truth_small, tmp_path
):
    output = shutil.copytree(truth_small.parent, tmp_path, dirs_exist_ok=True) / truth_small.name
    write_grasps(tmp_path / "g.h5", [true_result(root, name, (0,)) for name in frame_names()])
    with pytest.raises(StaleOutputError, match="--overwrite"):
        run(tmp_path / "g.h5", root, output)
    with pytest.raises(StaleOutputError, match="--overwrite"):
        run(small_file, root, output, frictions=(0.4,))
    run(tmp_path / "g.h5", root, output, overwrite=True)
    assert read_json(output)["reasons"]["all"]["0.5"] == {"no grasp": 8, "held": 4}


@pytest.mark.parametrize(
    "file",
    [
        "models/000/nontextured.ply",
        "symmetry/000.json",
        "scenes/scene_0100/realsense/annotations/0000.xml",
        "scenes/scene_0100/realsense/label/0000.png",
        "scenes/scene_0100/realsense/cam0_wrt_table.npy",
    ],
)
def test_another_truth_makes_rates_stale(root, small_file, truth_small, tmp_path, file):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    output = Path(shutil.copytree(truth_small.parent, tmp_path / "out")) / truth_small.name
    assert run(small_file, other, output).done == []
    (other.root / file).write_bytes((other.root / file).read_bytes() + b" ")
    with pytest.raises(StaleOutputError):
        run(small_file, other, output)


def test_a_dry_run_writes_nothing(root, small_file, tmp_path):
    report = run(small_file, root, tmp_path / "success.json", dry_run=True)
    assert len(report.notes) == len(SCENES) + len(KINDS)  # no toy has convex pieces yet
    assert list(tmp_path.iterdir()) == []


def test_objects_of_failed_and_empty_frames_count_as_trials_without_grasp(root, tmp_path):
    first, second, *_ = frame_names()
    results = [FrameResult(first, "failed", "cut off"), FrameResult(second, "empty")]
    write_grasps(tmp_path / "g.h5", results)
    assert run(tmp_path / "g.h5", root, tmp_path / "success.json").exit_code == 0
    success = read_json(tmp_path / "success.json")
    assert success["reasons"]["all"]["0.5"] == {"no grasp": 6}
    assert success["success"]["seen"]["sphere"]["0.5"]["trials"] == 2


def test_a_grasp_moved_off_its_object_fails(root, tmp_path):
    name = frame_names()[0]
    result = true_result(root, name)
    shift = 0.1 * np.array([0.0, 0.0, -1.0])  # towards the camera
    grasps = replace(result.grasps, translation=result.grasps.translation + shift)
    write_grasps(tmp_path / "g.h5", [replace(result, grasps=grasps)])
    run(tmp_path / "g.h5", root, tmp_path / "success.json")
    assert "held" not in read_json(tmp_path / "success.json")["reasons"]["all"]["0.5"]


def test_convex_pieces_of_the_dataset_are_used(small_file, tmp_path):
    own = write_root(tmp_path / "root")
    for object_id in KINDS:
        model = own.model_path(object_id)
        mesh = read_mesh(model)
        elsewhere = replace(mesh, vertices=mesh.vertices + 0.2)
        convex_pieces.write(model.with_name("convex.npz"), [elsewhere])
    report = run(small_file, own, tmp_path / "success.json")
    assert len(report.done) == len(SCENES)
    assert not simulate.pieces_folder(tmp_path / "success.json").exists()
    assert read_json(tmp_path / "success.json")["success"]["all"]["rotation"]["0.5"]["held"] == 0


def test_cached_pieces_of_another_mesh_are_made_again(small_file, tmp_path):
    own, output = write_root(tmp_path / "root"), tmp_path / "success.json"
    run(small_file, own, output)
    pieces = simulate.pieces_folder(output) / "002.npz"
    before = pieces.read_bytes()
    mesh = read_mesh(own.model_path(2))
    write_mesh(own.model_path(2), replace(mesh, vertices=1.01 * mesh.vertices))
    with pytest.raises(StaleOutputError, match="--overwrite"):
        run(small_file, own, output)
    output.unlink()
    report = run(small_file, own, output)
    assert report.done == ["model 002", *(f"scene_{s:04d}_realsense" for s in SCENES)]
    assert pieces.read_bytes() != before


def write_tray_root(folder: Path, grasps: Path) -> GraspNetRoot:
    """A dataset whose first object is a tray, and a grasp of its wall from outside and inside."""
    root = write_root(folder)
    mesh = tray()
    bottom = replace(mesh, vertices=mesh.vertices - [0, 0, 0.05 + mesh.vertices[:, 2].min()])
    write_mesh(root.model_path(0), bottom)
    results = []
    for name in frame_names()[::2]:
        wall = GraspPoses(DOWN, np.array([0.0, 0.047, 0.045]), np.array(0.006))
        wall = wall.transformed(invert(camera_in_table(root.frame(name).frame_id)))
        results.append(replace(true_result(root, name, (0,)), grasps=grasp_table(wall)))
    write_grasps(grasps, results)
    return root


def test_models_without_pieces_are_cut_by_coacd_once(tmp_path, monkeypatch):
    grasps, output = tmp_path / "g.h5", tmp_path / "out" / "success.json"
    root = write_tray_root(tmp_path / "root", grasps)
    report = run(grasps, root, output, frictions=(0.8,))
    assert "model 000" in report.done
    assert len(convex_pieces.read(simulate.pieces_folder(output) / "000.npz")) >= 5
    kinds = read_json(output)["success"]["all"]["reflection"]
    assert (kinds["0.8"]["held"], kinds["0.8"]["trials"]) == (2, 2)  # a finger in the hollow
    monkeypatch.setattr(convex_decomposition.sys, "executable", "/bin/false")
    whole = content_of(output.parent)
    output.unlink()
    shutil.rmtree(simulate.trials_folder(output))
    assert run(grasps, root, output, frictions=(0.8,)).notes == {}  # from the cache, as before
    assert content_of(output.parent) == whole


def test_a_model_that_crashes_coacd_is_simulated_as_its_hull_and_named(tmp_path, monkeypatch):
    monkeypatch.setattr(convex_decomposition.sys, "executable", "/bin/false")
    grasps, output = tmp_path / "g.h5", tmp_path / "out" / "success.json"
    root = write_tray_root(tmp_path / "root", grasps)
    report = run(grasps, root, output, frictions=(0.8,))
    assert report.exit_code == 0
    assert list(report.notes) == ["model 000"]
    assert "as its convex hull" in report.notes["model 000"]
    assert read_json(output)["reasons"]["all"]["0.8"]["collision"] == 2


def test_a_run_killed_while_it_cuts_models_leaves_no_incomplete_pieces(
    root, small_file, truth_small, tmp_path
):
    output = tmp_path / "success.json"
    script = KILLED.format(function="stamp_ahead")
    command = [sys.executable, "-c", script, str(small_file), str(root.root), str(output)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    folder = simulate.pieces_folder(output)
    assert [path.name for path in folder.glob("*.npz")] == ["000.npz"]
    assert len(convex_pieces.read(folder / "000.npz")) == 1
    report = run(small_file, root, output)
    assert report.skipped == ["model 000"]
    assert content_of(tmp_path) == content_of(truth_small.parent)


def test_a_scene_with_a_damaged_label_fails_alone(tmp_path):
    root = write_root(tmp_path / "root")
    label = root.frame(frame_names()[0]).path("label")
    label.write_bytes(label.read_bytes()[:100])
    results = [FrameResult(name, "empty") for name in frame_names()[:2]]
    results += [true_result(root, name) for name in frame_names()[2:]]
    write_grasps(tmp_path / "g.h5", results)
    report = run(tmp_path / "g.h5", root, tmp_path / "success.json")
    assert list(report.failed) == ["scene_0100_realsense"]
    content = read_json(tmp_path / "success.json")
    assert content["success"]["all"]["all"]["0.5"]["held"] == 6
    assert content["failed"] == report.failed


def test_objects_are_those_with_a_pose_and_one_that_cannot_be_cut_is_named(root, tmp_path):
    own = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    for scene in SCENES:  # the lists of objects are incomplete or missing
        (own.scene_folder(scene) / "object_id_list.txt").write_text("0\n")
    (own.scene_folder(SCENES[1]) / "object_id_list.txt").unlink()
    write_grasps(tmp_path / "g.h5", [FrameResult(name, "empty") for name in frame_names()])
    report = run(tmp_path / "g.h5", own, tmp_path / "success.json")
    assert (report.exit_code, len(report.done)) == (0, len(KINDS) + len(SCENES))
    flat = read_mesh(own.model_path(1))
    flat = replace(flat, vertices=flat.vertices[:3], faces=np.array([[0, 1, 2]]))
    write_mesh(own.model_path(1), flat)
    symmetry_labels.write(own.symmetry_path(1), ObjectSymmetries("001", (), ()), STAMP)
    report = run(tmp_path / "g.h5", own, tmp_path / "other.json")
    assert set(report.failed) == {"model 001", *(f"scene_{s:04d}_realsense" for s in SCENES)}
    assert "object 001 has no convex pieces" in report.failed["scene_0100_realsense"]


def test_objects_that_move_far_until_they_rest_give_a_note(tmp_path):
    root = write_root(tmp_path / "root")
    poses = [pose @ make_pose(np.eye(3), [0.0, 0.0, 0.03]) for pose in poses_in_camera(0).values()]
    files = root.frame(frame_names()[0])
    listed = [ObjectPose(i, pose) for i, pose in enumerate(poses)]
    write_annotation(files.path("annotations"), listed)
    write_meta(files.path("meta"), listed, CAMERA.matrix)
    write_grasps(tmp_path / "g.h5", [FrameResult(files.name, "empty")])
    report = run(tmp_path / "g.h5", root, tmp_path / "success.json")
    assert "30 mm until they rested" in report.notes["scene_0100_realsense"]


def test_a_frame_without_objects_has_no_trials_and_other_frames_go_on(tmp_path):
    root = write_root(tmp_path / "root")
    bare, *others = frame_names()[1:]
    files = root.frame(bare)
    write_annotation(files.path("annotations"), [])
    write_meta(files.path("meta"), [], CAMERA.matrix)
    write_label(files.path("label"), np.zeros((CAMERA.height, CAMERA.width), np.uint8))
    results = [FrameResult(bare, "empty"), *(true_result(root, name) for name in others)]
    write_grasps(tmp_path / "g.h5", results)
    report = run(tmp_path / "g.h5", root, tmp_path / "success.json", baselines=True)
    assert (report.exit_code, report.notes) == (0, {})
    rates = read_json(tmp_path / "success.json")["success"]["all"]["all"]["0.5"]
    assert (rates["held"], rates["trials"]) == (6, 6)


def test_a_file_without_frames_is_refused_in_a_sentence(root, tmp_path):
    write_grasps(tmp_path / "g.h5", [])
    with pytest.raises(SymgraspError, match="holds no frames"):
        run(tmp_path / "g.h5", root, tmp_path / "success.json")


@pytest.mark.parametrize("name", ["scenes/scene_0007/realsense/0000", "table_color"])
def test_grasps_of_another_dataset_are_refused_in_a_sentence(root, tmp_path, name):
    write_grasps(tmp_path / "g.h5", [FrameResult(name, "empty")])
    with pytest.raises(FormatError, match=f"frame {name} is not in"):
        run(tmp_path / "g.h5", root, tmp_path / "success.json")


def test_an_unknown_gripper_is_refused_before_anything_is_done(root, small_file, tmp_path):
    with pytest.raises(UnknownNameError, match="hand"):
        run(small_file, root, tmp_path / "success.json", gripper="hand")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("friction", ["", "0.3,much", "0.3,-1", "0", "nan"])
def test_frictions_that_are_no_positive_numbers_are_wrong_usage(root, small_file, friction):
    arguments = ["simulate", str(small_file), "--dataset", str(root.root), "--friction", friction]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "--friction" in result.output


def test_the_command_prints_the_rates(root, small_file, tmp_path):
    out = tmp_path / "success.json"
    arguments = ["simulate", str(small_file), "--dataset", str(root.root), "--out", str(out)]
    result = CliRunner().invoke(app, [*arguments, "--friction", "0.8,0.5,0.5"])
    assert result.exit_code == 0
    assert "Success in simulation" in result.output
    assert read_json(out)["frictions"] == [0.5, 0.8]
