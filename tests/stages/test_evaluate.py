"""`evaluate` on a dataset whose truth is known."""

import os
import shutil
import signal
import subprocess
import sys
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import evaluate, evaluate_dump, export, simulate
from pipelines.configs import EvaluateConfig, EvaluateDumpConfig, ExportConfig, SimulateConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.errors import FormatError, StaleOutputError, SymgraspError, ValueRangeError
from pipelines.evaluation.reports import reports
from pipelines.evaluation.rows import BASELINE_ROWS
from pipelines.evaluation.runs import other_runs
from pipelines.evaluation.runs.bootstrap_units import VIEWS_NOTE
from pipelines.evaluation.runs.records import read_frame_records, records_folder
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_stream import read_dataset_frames, read_index, read_results
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import GRIPPERS, gripper_digest
from pipelines.runtime.batch import BatchOptions, StageReport
from pipelines.storage.files import read_json, write_json
from pipelines.storage.images import read_image, write_image
from pipelines.storage.provenance import digest, make_stamp
from symgrasp_cli.app import app
from tests.stages.toy_root import SCENES, frame_names, true_result, write_grasps, write_root

QUIET = BatchOptions(progress=False)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> GraspNetRoot:
    return write_root(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def truth_file(root: GraspNetRoot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("truth") / "grasps.h5"
    write_grasps(path, [true_result(root, name) for name in frame_names()])
    return path


def run(grasps: Path, root: GraspNetRoot, output: Path, **options) -> StageReport:
    baselines, success = options.pop("baselines", False), options.pop("success", ())
    others = options.pop("others", ())
    return evaluate.run(
        grasps,
        root.root,
        output,
        EvaluateConfig(min_visible_pixels=100),
        BatchOptions(progress=False, **options),
        others=others,
        baselines=baselines,
        success=(success,) if isinstance(success, Path) else success,
    )


def figures(output: Path, row: str = "ours", split: str = "all") -> dict:
    return reports.read_report(output)["rows"][row][split]


@pytest.fixture(scope="module")
def truth_report(root, truth_file, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("report") / "report.json"
    assert run(truth_file, root, output, baselines=True).exit_code == 0
    return output


@pytest.fixture(scope="module")
def judged(root, truth_file, tmp_path_factory) -> Path:
    """A report of the truth alone, without other methods."""
    output = tmp_path_factory.mktemp("judged") / "report.json"
    assert len(run(truth_file, root, output).done) == len(SCENES)
    return output


@pytest.fixture
def output(judged, tmp_path) -> Path:
    """A copy of that report and its records, for a further run."""
    return shutil.copytree(judged.parent, tmp_path, dirs_exist_ok=True) / judged.name


def test_the_truth_as_prediction_has_every_average_precision_one(truth_report):
    found = figures(truth_report)
    assert found["symmetry_ap"] == {"reflection": 1.0, "rotation": 1.0, "sphere": 1.0}
    assert found["mask_ap50"] == 1.0
    assert all(set(ap.values()) == {1.0} for ap in found["symmetry_ap_strict"].values())


def test_perfect_grasps_have_quality_and_antipodal_score_one(truth_report):
    found = figures(truth_report)
    assert found["grasp_quality"] == pytest.approx(1.0, abs=0.06)  # ball and can are polyhedra
    assert found["antipodal_score"] == pytest.approx(1.0, abs=0.01)
    assert 0.5 < found["antipodal_score_region"] <= 1.0
    assert found["reasons"] == {"held": 12}


def test_ap_by_graspnets_protocol_is_that_of_the_exported_grasps(root, truth_file, tmp_path):
    results = [true_result(root, name) for name in frame_names()]
    few = [replace(each, grasps=each.grasps.taken(np.arange(2))) for each in results[::2]]
    write_grasps(tmp_path / "few.h5", few + results[1::2])
    run(tmp_path / "few.h5", root, tmp_path / "report.json")
    export.run(tmp_path / "few.h5", tmp_path / "dump", ExportConfig(to="graspnet"))
    config = EvaluateDumpConfig(exact=True)
    evaluate_dump.run(tmp_path / "dump", root.root, tmp_path / "dump.json", config, QUIET)
    dumped = [each["all"] for each in reports.read_report(tmp_path / "dump.json")["rows"].values()]
    found = figures(tmp_path / "report.json")
    for name in ("ap", "ap_0.8", "ap_0.4"):
        exported = np.average([d[name] for d in dumped], weights=[d["frames"] for d in dumped])
        assert found[name] == pytest.approx(exported)
    assert 0.0 < found["ap_0.4"] < figures_of_whole(truth_file, root, tmp_path)["ap_0.4"]


def figures_of_whole(grasps: Path, root: GraspNetRoot, folder: Path) -> dict:
    run(grasps, root, folder / "whole.json")
    return figures(folder / "whole.json")


def test_a_stray_picture_that_infer_failed_on_is_left_out(root, tmp_path):
    results = [true_result(root, name) for name in frame_names()]
    scene = results[0].name.rsplit("/", 1)[0]
    stray = FrameResult(f"{scene}/._0000", "failed", "this PNG is cut off")
    write_grasps(tmp_path / "g.h5", [stray, *results])
    assert run(tmp_path / "g.h5", root, tmp_path / "report.json").exit_code == 0
    assert figures(tmp_path / "report.json")["frames"] == len(results)
    write_grasps(tmp_path / "h.h5", [replace(results[0], name="elsewhere/0000")])
    with pytest.raises(FormatError, match=r"elsewhere/0000 is not in .*that infer was run on"):
        run(tmp_path / "h.h5", root, tmp_path / "other.json")


@pytest.mark.parametrize("below", ["scenes", "scenes/scene_0100", "scenes/scene_0100/realsense"])
def test_frames_of_a_part_of_a_dataset_are_judged_as_in_the_whole(
    root, truth_file, truth_report, tmp_path, below
):
    whole = read_index(truth_file).names
    results = [
        replace(found, name=found.name.removeprefix(f"{below}/"))
        for found in read_results(truth_file, range(len(whole)))
        if found.name.startswith(f"{below}/")
    ]
    folder = os.path.relpath(root.root / below, tmp_path.resolve())
    stamp = replace(make_stamp("infer", {"gripper": "rg2"}), recorded={"frames": folder})
    grasps_file.write(tmp_path / "g.h5", results, stamp)
    report = run(tmp_path / "g.h5", root, tmp_path / "report.json")
    assert (report.exit_code, report.notes) == (0, {})
    expected = figures(truth_report, split="seen")
    assert figures(tmp_path / "report.json", split="seen") == expected
    scene = "scene_0100_realsense.json"
    part, all_of_it = (
        read_frame_records(records_folder(output) / scene)
        for output in (tmp_path / "report.json", truth_report)
    )
    assert [record.name for record in part] == [record.name for record in all_of_it]


def test_meshes_with_inward_normals_are_judged_as_if_turned_outward(
    truth_file, truth_report, tmp_path
):
    turned = write_root(tmp_path / "root")
    for object_id in turned.object_ids():
        path = turned.model_path(object_id)
        mesh = read_mesh(path)
        write_mesh(path, replace(mesh, faces=mesh.faces[:, ::-1]))
    run(truth_file, turned, tmp_path / "report.json")
    assert figures(tmp_path / "report.json")["reasons"] == {"held": 12}
    expected = figures(truth_report)["grasp_quality"]
    assert figures(tmp_path / "report.json")["grasp_quality"] == pytest.approx(expected, abs=0.02)


def test_every_scene_counts_in_its_split(truth_report):
    counted = {s: figures(truth_report, split=s)["frames"] for s in ("seen", "similar", "novel")}
    assert counted == {"seen": 2, "similar": 0, "novel": 2}
    assert figures(truth_report)["objects"] == 12


def test_a_split_without_frames_has_no_figures(truth_report):
    found = figures(truth_report, split="similar")
    assert found["grasp_quality"] is None
    assert found["symmetry_ap"]["sphere"] is None


def test_the_oracle_holds_objects_and_random_grasps_are_no_better(truth_report):
    oracle = figures(truth_report, "oracle")
    assert oracle["grasp_quality"] > 0.5
    assert oracle["mask_ap50"] == 1.0  # of our regions, which the baselines grasp
    assert oracle["symmetry_ap"] == {"reflection": 1.0, "rotation": 1.0, "sphere": 1.0}
    assert figures(truth_report, "random")["grasp_quality"] <= oracle["grasp_quality"]
    assert figures(truth_report, "planar")["symmetry_ap"]["reflection"] is None
    assert figures(truth_report, "planar-critic")["objects"] == oracle["objects"]


def test_the_page_holds_tables_and_frames_and_needs_no_network(truth_report):
    page = truth_report.with_suffix(".html").read_text()
    assert "oracle" in page
    assert "Table III" in page
    assert page.count("data:image/jpeg;base64,") == 2 * len(SCENES)  # the best, the worst
    assert "http" not in page


def test_a_frame_without_its_image_is_named_and_the_report_is_complete(truth_file, tmp_path):
    root = write_root(tmp_path / "root")
    for name in frame_names():
        root.frame(name).path("rgb").unlink()
    report = run(truth_file, root, tmp_path / "report.json")
    assert len(report.notes) == 2 * len(SCENES)
    assert all("gallery" in note for note in report.notes.values())
    assert figures(tmp_path / "report.json")["objects"] == 12


def write_success(path: Path, grasps: Path, **content) -> Path:
    rates = {"trials": 20, "held": 15, "rate": 0.75, "low": 0.53, "high": 0.89}
    found = {
        "format_version": 1,
        "frictions": [0.3, 0.5],
        "success": {s: {"sphere": {"0.3": rates, "0.5": rates}} for s in ("seen", "all")},
        "provenance": make_stamp("simulate", {}, inputs={"grasps": digest(grasps)}).as_json(),
    }
    write_json(path, found | content)
    return path


def test_success_is_added_to_the_figures_without_judging_again(root, truth_file, output, tmp_path):
    success = write_success(tmp_path / "success.json", truth_file)
    assert run(truth_file, root, output, success=success).done == []
    assert figures(output)["success"]["sphere"]["held"] == 15
    assert figures(output, split="novel")["success"] == {}
    report = reports.read_report(output)
    assert report["success_by_friction"]["seen"]["sphere"]["0.3"]["held"] == 15
    assert report["success_baselines"] == {}
    assert "75 (53-89)" in output.with_suffix(".html").read_text()


def test_the_page_says_that_rates_lack_scenes(root, truth_file, output, tmp_path):
    failed = {"scene_0100_realsense": "its label is <damaged>"}
    success = write_success(tmp_path / "success.json", truth_file, failed=failed)
    notes = run(truth_file, root, output, success=success).notes
    assert "scene_0100_realsense: its label is <damaged>" in notes["success of ours"]
    page = output.with_suffix(".html").read_text()
    assert "scene_0100_realsense: its label is &lt;damaged&gt;" in page


def test_success_of_other_methods_is_in_their_rows(root, truth_file, tmp_path):
    rates = {"trials": 20, "held": 4, "rate": 0.2, "low": 0.08, "high": 0.42}
    beside = {"success": {s: {"all": {"0.5": rates}} for s in ("seen", "all")}, "reasons": {}}
    success = write_success(tmp_path / "success.json", truth_file, baselines={"random": beside})
    output = tmp_path / "report.json"
    run(truth_file, root, output, baselines=True, success=success)
    assert figures(output, "random")["success"]["all"]["held"] == 4
    assert figures(output, "planar").get("success") is None
    assert "20 (8-42)" in output.with_suffix(".html").read_text()


def test_each_row_may_have_its_own_success_file(root, truth_file, tmp_path):
    other = tmp_path / "second.h5"
    write_grasps(other, [true_result(root, name, (0, 1)) for name in frame_names()])
    rates = {"trials": 20, "held": 4, "rate": 0.2, "low": 0.08, "high": 0.42}
    theirs = write_success(
        tmp_path / "second.json",
        other,
        success={s: {"all": {"0.5": rates}} for s in ("seen", "all")},
    )
    ours = write_success(tmp_path / "success.json", truth_file)
    output = tmp_path / "report.json"
    run(truth_file, root, output, others=[other], success=[theirs, ours])
    assert figures(output, "second")["success"]["all"]["held"] == 4
    assert figures(output)["success"]["sphere"]["held"] == 15
    assert "20 (8-42)" in output.with_suffix(".html").read_text()
    with pytest.raises(FormatError, match=r"second\.json.*second file of row second"):
        run(truth_file, root, output, others=[other], success=[theirs, theirs])
    run(truth_file, root, output, others=[other], success=[theirs])
    assert reports.read_report(output)["success_by_friction"] == {}


def test_success_of_other_grasps_is_refused_before_anything_is_judged(root, truth_file, tmp_path):
    other = {"provenance": {"inputs": {"grasps": "sha256:0"}}}
    success = write_success(tmp_path / "success.json", truth_file, **other)
    with pytest.raises(FormatError, match="other grasps"):
        run(truth_file, root, tmp_path / "report.json", success=success)
    assert [path.name for path in tmp_path.iterdir()] == ["success.json"]


@pytest.mark.parametrize("kind", ["gripper", "symmetry", "meshes", "scenes"])
def test_success_with_another_hand_or_dataset_is_refused(root, truth_file, output, tmp_path, kind):
    stamp = reports.read_report(output)["provenance"]
    success = write_success(tmp_path / "success.json", truth_file, provenance=stamp)
    run(truth_file, root, output, success=success)
    other = {"inputs": stamp["inputs"] | {kind: "sha256:0"}}
    success = write_success(tmp_path / "success.json", truth_file, provenance=other)
    with pytest.raises(FormatError, match=rf"success\.json.* other inputs \({kind}\); run"):
        run(truth_file, root, output, success=success)


@pytest.mark.parametrize("content", [{"success": 3}, {"format_version": 9}])
def test_a_wrong_success_file_is_reported_in_one_sentence(root, truth_file, tmp_path, content):
    success = write_success(tmp_path / "success.json", truth_file, **content)
    with pytest.raises(FormatError, match=r"success\.json"):
        run(truth_file, root, tmp_path / "report.json", success=success)


def test_one_frame_at_a_time_is_in_memory(root, truth_file, tmp_path, monkeypatch):
    seen = []

    def watched(path, frames):
        for found in read_dataset_frames(path, frames):
            seen.append(weakref.ref(found))
            assert sum(each() is not None for each in seen) <= 2  # the last frame, this frame
            yield found

    monkeypatch.setattr(other_runs, "read_dataset_frames", watched)
    run(truth_file, root, tmp_path / "report.json")
    assert len(seen) == len(frame_names())


KILLED = """
import os, signal, sys
from pathlib import Path
from pipelines import evaluate
from pipelines.runtime.batch import BatchOptions
from pipelines.configs import EvaluateConfig

write, written = evaluate.write_frame_records, []

def write_then_die(*arguments):
    if written:
        os.kill(os.getpid(), signal.SIGKILL)
    write(*arguments)
    written.append(1)

evaluate.write_frame_records = write_then_die
paths = [Path(argument) for argument in sys.argv[1:]]
evaluate.run(*paths, EvaluateConfig(min_visible_pixels=100), BatchOptions(progress=False))
"""


def test_the_unit_of_the_intervals_is_stated_and_changes_without_judging_again(
    root, truth_file, output
):
    pages = []
    for options, unit in (([], "scene"), (["--unit", "frame"], "frame")):
        arguments = [str(truth_file), "--dataset", str(root.root), "--out", str(output), *options]
        shown = CliRunner().invoke(
            app, ["evaluate", *arguments, "--min-visible-pixels", "100"], env={"COLUMNS": "10000"}
        )
        assert shown.exit_code == 0
        assert "0 done, 2 skipped" in shown.output
        assert reports.read_report(output)["interval_unit"] == unit
        pages.append(output.with_suffix(".html").read_text())
        for text in (pages[-1], shown.output):
            assert f"bootstrap over {unit}s; none over fewer than 6 {unit}s" in text
            assert (VIEWS_NOTE in text) == (unit == "frame")
    notes = [table.note for table in evaluate.tables(output) if "In brackets" in table.note]
    assert len(notes) == 6  # quality, its sweep, two antipodal scores, AP of grasps and symmetries


def test_a_killed_run_goes_on_where_it_was_and_gives_the_same_bytes(
    root, truth_file, judged, tmp_path
):
    output = tmp_path / "report.json"
    command = [sys.executable, "-c", KILLED, str(truth_file), str(root.root), str(output)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    assert not output.exists()
    report = run(truth_file, root, output)
    assert (len(report.skipped), len(report.done)) == (1, len(SCENES) - 1)
    for suffix in (".json", ".html"):
        assert output.with_suffix(suffix).read_bytes() == judged.with_suffix(suffix).read_bytes()
    folders = [records_folder(path) for path in (judged, output)]
    names = [sorted(path.name for path in folder.iterdir()) for folder in folders]
    assert names[0] == names[1]


@pytest.mark.parametrize(
    "file",
    [
        "symmetry/000.json",
        "models/000/nontextured.ply",
        "scenes/scene_0100/realsense/annotations/0000.xml",
        "scenes/scene_0100/realsense/label/0001.png",
        "scenes/scene_0100/realsense/cam0_wrt_table.npy",
    ],
)
def test_another_truth_makes_a_report_stale(truth_file, truth_report, root, tmp_path, file):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    report = Path(shutil.copytree(truth_report.parent, tmp_path / "report")) / truth_report.name
    assert run(truth_file, other, report, baselines=True).done == []
    (other.root / file).write_bytes((other.root / file).read_bytes() + b" ")
    with pytest.raises(StaleOutputError):
        run(truth_file, other, report, baselines=True)


def test_truth_about_other_objects_and_scenes_makes_no_report_stale(
    truth_file, truth_report, root, tmp_path
):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    shutil.copytree(other.root / "models/000", other.root / "models/077")
    shutil.copytree(other.scene_folder(SCENES[0]), other.scene_folder(189))
    report = Path(shutil.copytree(truth_report.parent, tmp_path / "report")) / truth_report.name
    assert run(truth_file, other, report, baselines=True).done == []


def test_a_gripper_file_that_changed_makes_a_report_stale(root, truth_file, tmp_path):
    hand, output = tmp_path / "hand.toml", tmp_path / "report.json"
    content = (GRIPPERS / "rg2.toml").read_text()
    config = EvaluateConfig(min_visible_pixels=100, gripper=str(hand))
    options = BatchOptions(progress=False)
    hand.write_text(content)
    evaluate.run(truth_file, root.root, output, config, options)
    hand.write_text(content.replace("clearance = 0.006", "clearance = 0.005"))
    with pytest.raises(StaleOutputError):
        evaluate.run(truth_file, root.root, output, config, options)


def test_an_object_without_region_has_quality_zero(root, tmp_path):
    write_grasps(tmp_path / "g.h5", [true_result(root, name, (0, 1)) for name in frame_names()])
    run(tmp_path / "g.h5", root, tmp_path / "report.json")
    found = figures(tmp_path / "report.json")
    assert found["grasp_quality"] == pytest.approx(2 / 3, abs=0.05)
    assert found["grasp_quality_predicted"] == pytest.approx(1.0, abs=0.06)
    assert found["reasons"] == {"no region": 4, "held": 8}
    assert found["symmetry_ap"]["sphere"] == 0.0
    assert found["mask_ap50"] == pytest.approx(2 / 3, abs=0.01)


def test_a_failed_frame_counts_its_objects(root, tmp_path):
    first, *others = frame_names()
    results = [FrameResult(first, "failed", "cut off"), *(true_result(root, n) for n in others)]
    write_grasps(tmp_path / "g.h5", results)
    run(tmp_path / "g.h5", root, tmp_path / "report.json", baselines=True)
    assert figures(tmp_path / "report.json")["objects"] == 12
    assert figures(tmp_path / "report.json")["reasons"]["no region"] == 3


def test_a_second_run_judges_nothing_again_and_a_resumed_run_only_the_rest(
    root, truth_file, output
):
    whole = output.read_bytes()
    assert run(truth_file, root, output).done == []
    records = sorted(records_folder(output).iterdir())
    records[0].unlink()
    output.unlink()
    assert run(truth_file, root, output).done == [records[0].stem]
    assert output.read_bytes() == whole


def test_a_report_of_other_grasps_is_replaced_only_on_request(root, output, tmp_path):
    write_grasps(tmp_path / "g.h5", [true_result(root, name, (0,)) for name in frame_names()])
    with pytest.raises(StaleOutputError, match="--overwrite"):
        run(tmp_path / "g.h5", root, output)
    run(tmp_path / "g.h5", root, output, overwrite=True)
    assert figures(output)["reasons"]["no region"] == 8


def test_a_file_of_another_program_is_not_replaced_even_on_request(root, truth_file, tmp_path):
    foreign = tmp_path / "settings.json"
    foreign.write_text('{"mine": 1}')
    with pytest.raises(SymgraspError, match="is no output of evaluate"):
        run(truth_file, root, foreign, overwrite=True)
    assert foreign.read_text() == '{"mine": 1}'


def test_records_of_former_scenes_do_not_stay_beside_a_new_report(root, output, tmp_path):
    less = [true_result(root, name) for name in frame_names() if "scene_0100" in name]
    write_grasps(tmp_path / "g.h5", less)
    run(tmp_path / "g.h5", root, output, overwrite=True)
    assert [path.stem for path in records_folder(output).iterdir()] == ["scene_0100_realsense"]


def test_a_scene_with_a_damaged_label_fails_alone(tmp_path):
    root = write_root(tmp_path / "root")
    label = root.frame(frame_names()[0]).path("label")
    label.write_bytes(label.read_bytes()[:100])
    write_grasps(tmp_path / "g.h5", [true_result(root, n) for n in frame_names()[2:]])
    results = [FrameResult(n, "empty") for n in frame_names()[:2]]
    results += [true_result(root, n) for n in frame_names()[2:]]
    write_grasps(tmp_path / "g.h5", results)
    report = run(tmp_path / "g.h5", root, tmp_path / "report.json")
    assert list(report.failed) == ["scene_0100_realsense"]
    assert report.done == ["scene_0160_realsense"]
    assert figures(tmp_path / "report.json")["frames"] == 2
    written = read_json(tmp_path / "report.json")
    assert written["failed"] == report.failed
    page = (tmp_path / "report.html").read_text()
    assert "Left out: 1 scene that could not be evaluated, for example scene_0100_realsense" in page


def test_a_label_of_another_size_than_the_depth_is_named(tmp_path):
    root = write_root(tmp_path / "root")
    write_grasps(tmp_path / "g.h5", [true_result(root, n) for n in frame_names()])
    label = root.frame(frame_names()[0]).path("label")
    write_image(label, read_image(label)[::2, ::2])
    report = run(tmp_path / "g.h5", root, tmp_path / "report.json")
    assert "0000.png: the label image is 160x120" in report.failed["scene_0100_realsense"]
    assert report.done == ["scene_0160_realsense"]


@pytest.mark.parametrize("command", ["evaluate", "simulate"])
def test_no_report_is_written_if_every_scene_fails(tmp_path, command):
    root, name = write_root(tmp_path / "root"), frame_names()[0]
    write_grasps(tmp_path / "g.h5", [true_result(root, name)])
    label = root.frame(name).path("label")
    label.write_bytes(label.read_bytes()[:100])
    out = tmp_path / "out" / "report.json"
    arguments = [command, str(tmp_path / "g.h5"), "--dataset", str(root.root), "--out", str(out)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "error: scene_0100_realsense: " in result.output
    assert not list(out.parent.glob("report.json*"))


def test_a_dry_run_writes_nothing(root, truth_file, tmp_path):
    report = run(truth_file, root, tmp_path / "report.json", dry_run=True)
    assert len(report.notes) == len(SCENES)
    assert list(tmp_path.iterdir()) == []


def test_records_read_as_they_were_written(truth_report):
    folder = records_folder(truth_report)
    frames = [record for path in sorted(folder.iterdir()) for record in read_frame_records(path)]
    assert [frame.name for frame in frames] == frame_names()
    assert {row for frame in frames for row in frame.rows} == {
        "ours", *BASELINE_ROWS,
    }  # fmt: skip
    worst = [v.min_friction for f in frames for row in f.rows.values() for v in row.verdicts]
    assert all(isinstance(value, float) and not np.isnan(value) for value in worst)


def test_other_grasps_of_the_same_frames_get_a_row_judged_on_their_own_regions(
    root, truth_file, tmp_path
):
    other = tmp_path / "second.h5"
    write_grasps(other, [true_result(root, name, (0, 1)) for name in frame_names()])
    report = run(truth_file, root, tmp_path / "report.json", others=[other])
    assert report.exit_code == 0
    ours, theirs = figures(tmp_path / "report.json"), figures(tmp_path / "report.json", "second")
    assert ours["reasons"] == {"held": 12}
    assert theirs["reasons"] == {"no region": 4, "held": 8}
    assert theirs["objects"] == ours["objects"]
    run(other, root, tmp_path / "alone.json")
    names, alone = ("mask_ap50", "mask_ap75", "mask_ap"), figures(tmp_path / "alone.json")
    assert [theirs[name] for name in names] == [alone[name] for name in names]
    assert theirs["mask_ap50"] == pytest.approx(2 / 3, abs=0.01)
    assert [ours[name] for name in names] == [1.0, 1.0, 1.0]
    titles = {row[0] for row in evaluate.tables(tmp_path / "report.json")[0].rows}
    assert {"SymGrasp", "second"} <= titles


def test_grasps_of_a_compared_method_belong_to_their_nearest_objects(root, truth_file, tmp_path):
    other, results = tmp_path / "gg-cnn.h5", []
    for name in frame_names():
        found = true_result(root, name, (0, 1))
        found.grasps.region[:] = 0  # regions do not matter
        results.append(found)
    write_grasps(other, results, "gg-cnn")
    assert run(truth_file, root, tmp_path / "report.json", others=[other]).exit_code == 0
    assert figures(tmp_path / "report.json", "gg-cnn")["reasons"] == {"no grasp": 4, "held": 8}
    assert figures(tmp_path / "report.json", "gg-cnn")["mask_ap50"] is None  # it knows no regions
    titles = {row[0] for row in evaluate.tables(tmp_path / "report.json")[0].rows}
    assert "GG-CNN, trained here" in titles
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Worst frames of GG-CNN, trained here" in page
    # Of our row, the best and the worst frame of a scene are shown; of the method, the worst.
    assert page.count("data:image/jpeg;base64,") == 3 * len(SCENES)


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("gg-cnn", "infer --method gg-cnn"),
        ("graspnet-selected", "infer --method graspnet"),
        ("symmetry-icp", "infer --method symmetry-icp"),
        ("as-printed", "infer --preset paper"),
    ],
)
def test_grasps_of_another_method_may_not_have_the_name_of_a_row(
    root, truth_file, tmp_path, name, command
):
    other = tmp_path / f"{name}.h5"
    write_grasps(other, [true_result(root, frame, (0, 1)) for frame in frame_names()])
    with pytest.raises(ValueRangeError, match=f"{name} is the row of grasps by `{command}`"):
        run(truth_file, root, tmp_path / "report.json", others=[other])


def test_a_frame_without_grasps_of_a_compared_method_counts_as_without_grasp_not_region(
    root, truth_file, tmp_path
):
    other = tmp_path / "gg-cnn.h5"
    write_grasps(other, [true_result(root, name, ()) for name in frame_names()], "gg-cnn")
    assert run(truth_file, root, tmp_path / "report.json", others=[other]).exit_code == 0
    found = figures(tmp_path / "report.json", "gg-cnn")
    assert found["reasons"] == {"no grasp": 12}
    assert not any(found["symmetry_ap"].values())


def grasps_for(path: Path, root: GraspNetRoot, gripper: str, measures: str | None = None) -> Path:
    """Write grasps for `gripper`; `measures`: its digest, which old files lack."""
    inputs = {} if measures is None else {"gripper": measures}
    stamp = make_stamp("infer", {"gripper": gripper}, inputs=inputs)
    grasps_file.write(path, [true_result(root, name) for name in frame_names()], stamp)
    return path


@pytest.mark.parametrize(
    ("gripper", "measures", "theirs"),
    [
        ("franka", None, "franka"),
        ("franka", gripper_digest("franka"), "franka"),
        ("rg2", "sha256:0", "another rg2"),
    ],
)
def test_other_grasps_for_another_gripper_are_refused_unless_a_gripper_is_named(
    root, truth_file, tmp_path, gripper, measures, theirs
):
    other = grasps_for(tmp_path / "second.h5", root, gripper, measures)
    output, config = tmp_path / "report.json", EvaluateConfig(min_visible_pixels=100)
    sentence = (
        f"has grasps for {theirs}, ours are for rg2; run this command on it alone and use `comp"
    )
    with pytest.raises(FormatError, match=sentence):
        run(truth_file, root, output, others=[other])
    with pytest.raises(FormatError, match=sentence):
        simulate.run(truth_file, root.root, output, SimulateConfig(), QUIET, others=[other])
    assert not output.exists()
    named = replace(config, gripper="rg2")
    found = evaluate.run(truth_file, root.root, output, named, QUIET, others=[other]).notes
    assert found == {
        "gripper of second": f"the grasps were found for {theirs} and are evaluated with rg2"
    }


@pytest.mark.parametrize("method", ["gg-cnn", "symmetry-icp", "network", "planar"])
def test_grasps_of_a_compared_method_in_place_of_ours_are_noted(root, tmp_path, method):
    path = tmp_path / "grasps.h5"
    write_grasps(path, [true_result(root, name) for name in frame_names()], method)
    notes = run(path, root, tmp_path / "report.json").notes
    if method in ("gg-cnn", "symmetry-icp"):
        assert f"those of `infer --method {method}`" in notes["method of ours"]
    else:
        assert notes == {}


def test_notes_on_the_method_and_on_the_gripper_do_not_hide_each_other(root, tmp_path):
    path = tmp_path / "grasps.h5"
    write_grasps(path, [true_result(root, name) for name in frame_names()], "gg-cnn")
    config = EvaluateConfig(min_visible_pixels=100, gripper="franka")
    output = tmp_path / "report.json"
    notes = evaluate.run(path, root.root, output, config, QUIET).notes
    assert any("those of `infer --method gg-cnn`" in note for note in notes.values())
    assert any("are evaluated with franka" in note for note in notes.values())
    assert reports.read_report(output)["notes"] == notes
    page = output.with_suffix(".html").read_text()
    assert all(f"{name}: {note}" in page for name, note in notes.items())


def test_a_gripper_of_another_name_with_the_same_measures_is_no_other_gripper(
    root, truth_file, tmp_path
):
    hand = tmp_path / "hand.toml"
    hand.write_text((GRIPPERS / "rg2.toml").read_text().replace('"rg2"', '"hand"'))
    other = grasps_for(tmp_path / "second.h5", root, str(hand), gripper_digest(str(hand)))
    report = run(truth_file, root, tmp_path / "report.json", others=[other])
    assert (report.exit_code, report.notes) == (0, {})


def test_frames_of_two_datasets_that_are_one_frame_of_the_given_one_are_refused(root, tmp_path):
    path = tmp_path / "grasps.h5"
    results = [true_result(root, name) for name in frame_names()]
    both = [replace(each, name=f"{folder}/{each.name}") for folder in "ab" for each in results]
    write_grasps(path, both)
    with pytest.raises(FormatError, match=r"grasps\.h5: holds the frame .*0000 twice"):
        run(path, root, tmp_path / "report.json")
    assert not records_folder(tmp_path / "report.json").exists()


def test_grasps_in_images_of_another_camera_are_refused_in_a_sentence(root, truth_file, tmp_path):
    results = [true_result(root, name) for name in frame_names()]
    for place, (change, words) in enumerate(
        [({"width": 160, "height": 120}, "160x120"), ({"fx": 450.0}, "focal length of 450")]
    ):
        other = tmp_path / f"other{place}.h5"
        cameras = [replace(each.intrinsics, **change) for each in results]
        empty = [FrameResult(r.name, "empty", "", c) for r, c in zip(results, cameras, strict=True)]
        write_grasps(other, empty)
        report = run(other, root, tmp_path / f"{place}.json")
        assert (report.exit_code, len(report.failed)) == (1, len(SCENES))
        assert all(words in sentence for sentence in report.failed.values())


def test_a_row_of_a_file_whose_name_is_not_utf8_has_a_printable_name(root, tmp_path):
    name, other = frame_names()[0], tmp_path / os.fsdecode(b"<b>\xff.h5")
    write_grasps(tmp_path / "grasps.h5", [true_result(root, name, (0,))])
    shutil.copy(tmp_path / "grasps.h5", other)
    run(tmp_path / "grasps.h5", root, tmp_path / "report.json", others=[other])
    assert figures(tmp_path / "report.json", "<b>%FF")["objects"] == 3
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;%FF" in page
    assert "<b>%FF" not in page


def test_a_dataset_with_other_scenes_of_the_same_numbers_is_refused(root, tmp_path):
    path, output = tmp_path / "root0" / "grasps.h5", tmp_path / "report.json"
    first, other = (Path(shutil.copytree(root.root, tmp_path / f"root{i}")) for i in range(2))
    stamp = replace(make_stamp("infer", {"gripper": "rg2"}), recorded={"frames": "."})
    grasps_file.write(path, [true_result(root, name) for name in frame_names()], stamp)
    scene = other / "scenes/scene_0160/realsense"
    for file in ("annotations/0000.xml", "depth/0000.png"):  # better poses alone are no other scene
        assert run(path, GraspNetRoot(other), output, dry_run=True).exit_code == 0
        (scene / file).write_bytes((scene / file).read_bytes() + b" ")
    with pytest.raises(FormatError, match=r"scene_0160/realsense/0000 was read from .*root0, and"):
        run(path, GraspNetRoot(other), output)
    assert run(path, GraspNetRoot(first), output, dry_run=True).exit_code == 0
    moved = Path(shutil.move(path, tmp_path / "grasps.h5"))  # its frames are no longer found
    write_grasps(path, [true_result(root, name) for name in frame_names()])  # without their folder
    for grasps in (moved, path):
        assert run(grasps, GraspNetRoot(other), output, dry_run=True).exit_code == 0


def test_other_grasps_of_other_frames_or_with_a_taken_name_are_refused(root, truth_file, tmp_path):
    fewer = tmp_path / "second.h5"
    write_grasps(fewer, [true_result(root, name) for name in frame_names()[1:]])
    with pytest.raises(FormatError, match="lacks 1 of our frames, for example"):
        run(truth_file, root, tmp_path / "report.json", others=[fewer])
    ours = tmp_path / "ours.h5"
    write_grasps(ours, [true_result(root, name) for name in frame_names()[:2]])
    with pytest.raises(FormatError, match=r"has frames that ours lacks, for example .*scene_0160"):
        run(ours, root, tmp_path / "report.json", others=[truth_file])
    taken = tmp_path / "oracle.h5"
    shutil.copy(truth_file, taken)
    with pytest.raises(ValueRangeError, match="oracle is the name of another row"):
        run(truth_file, root, tmp_path / "report.json", others=[taken])
    assert not (tmp_path / "report.json").exists()
