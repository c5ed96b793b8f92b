"""`compare` on runs whose differences are known."""

import json
import os
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import compare
from pipelines.configs import CompareConfig, EvaluateConfig, EvaluateDumpConfig
from pipelines.errors import (
    FormatError,
    MissingInputError,
    StaleOutputError,
    SymgraspError,
    UnknownNameError,
)
from pipelines.evaluation.graspnet.dump_verdicts import (
    FrameVerdicts,
    read_dump_verdicts,
    scenes_folder,
    write_dump_verdicts,
)
from pipelines.evaluation.graspnet.graspnet_figures import DumpTotals
from pipelines.evaluation.reports.figures import report_rows
from pipelines.evaluation.reports.reports import write_report
from pipelines.evaluation.runs.bootstrap_units import VIEWS_NOTE
from pipelines.evaluation.runs.paired_runs import EvaluatedRun
from pipelines.evaluation.runs.records import (
    FrameRecord,
    RowRecord,
    ScoredPredictions,
    number_key,
    records_folder,
    write_frame_records,
)
from pipelines.evaluation.runs.tallies import ReportTally
from pipelines.evaluation.runs.trial_records import (
    FrameTrials,
    Outcome,
    TrialRecord,
    trials_folder,
    write_trials,
)
from pipelines.metrics.coco_masks import IOU_THRESHOLDS
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.metrics.graspnet.graspnet_ap import AP_FRICTIONS, RANKS
from pipelines.simulation.success import write_success
from pipelines.storage.provenance import make_stamp
from symgrasp_cli.app import app

CONFIG = CompareConfig(unit="frame", resamples=200)  # runs of two scenes
SCENES = {"scene_0100_kinect": "seen", "scene_0160_kinect": "novel"}


def judged(rng: np.random.Generator, keys: list[str], num_truth: int) -> ScoredPredictions:
    verdicts = {key: rng.choice([-1, 0, 1], 4, p=[0.2, 0.3, 0.5]).tolist() for key in keys}
    return ScoredPredictions(num_truth, rng.random(4).round(1).tolist(), verdicts)


def frame(name: str, split: str, better: float, seed: int, objects: int = 3) -> FrameRecord:
    """Three objects of random quality, raised by `better`; random symmetries and masks."""
    place = crc32(name.encode())
    rng, shared = np.random.default_rng([seed, place]), np.random.default_rng(place)
    quality = shared.uniform(0.1, 0.5, objects) + better
    verdicts = [Verdict(i, "held", float(q), 1 - float(q), 0.9) for i, q in enumerate(quality)]
    kinds = {
        kind: judged(rng, ["0.25", "0.134", "0.067"], 3) for kind in ("reflection", "rotation")
    }
    kinds["sphere"] = judged(rng, ["0.05"], 1)
    masks = judged(rng, [f"{iou:g}" for iou in IOU_THRESHOLDS], 3)
    masks = ScoredPredictions(
        3, masks.confidence, {key: [max(v, 0) for v in vs] for key, vs in masks.verdicts.items()}
    )
    return FrameRecord(name, split, 0.1, masks, {"ours": RowRecord(verdicts, kinds)})


def write_run(folder: Path, better: float = 0.0, seed: int = 0, frames: int = 5, **options) -> Path:
    """Write a report with its records; `options`: objects of a frame, gripper, labels, others."""
    path = folder / "report.json"
    settings = EvaluateConfig(gripper=options.get("gripper", "rg2"))
    inputs = {"grasps": f"sha256:{folder.name}", "symmetry": options.get("labels", "a")}
    inputs["scenes"] = options.get("scenes", "a")
    inputs |= {f"with {row}": "sha256:0" for row in options.get("others", [])}
    stamp = make_stamp("evaluate", settings, inputs=inputs)
    records = []
    for scene, split in SCENES.items():
        scene_number = scene.split("_")[1]
        names = [f"scenes/scene_{scene_number}/kinect/{i:04d}" for i in range(frames)]
        found = [frame(n, split, better, seed, options.get("objects", 3)) for n in names]
        write_frame_records(records_folder(path) / f"{scene}.json", found, stamp)
        records += found
    tally = ReportTally.of(records)
    write_report(path, report_rows(tally, (0.25, 0.134, 0.067), 0.05), stamp)
    return path


def figure(found: compare.Comparison, metric: str, split: str = "all") -> compare.Figure:
    return next(f for f in found.figures if (f.metric, f.split) == (metric, split))


def test_a_constant_gain_is_found_and_certain(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", better=0.1)]
    found = figure(compare.run(paths, CONFIG), "grasp_quality")
    assert found.differences[0].value == pytest.approx(0.1)
    assert found.differences[0].low == pytest.approx(0.1)
    assert found.differences[0].is_certain
    assert found.frames == 10


def test_values_are_those_of_the_reports(tmp_path):
    paths = [write_run(tmp_path / "a", seed=1), write_run(tmp_path / "b", seed=2)]
    found = compare.run(paths, CONFIG)
    for place, path in enumerate(paths):
        for split, figures in json.loads(path.read_text())["rows"]["ours"].items():
            if not figures["frames"]:
                continue
            for metric in ("grasp_quality", "antipodal_score", "mask_ap50"):
                assert figure(found, metric, split).values[place] == pytest.approx(figures[metric])
            for kind, value in figures["symmetry_ap"].items():
                values = figure(found, f"symmetry_ap {kind}", split).values
                assert values[place] == pytest.approx(value)


def test_every_run_is_compared_with_the_first(tmp_path):
    gains = {"a": 0.0, "b": 0.2, "c": -0.05}
    found = compare.run([write_run(tmp_path / n, better=g) for n, g in gains.items()], CONFIG)
    assert found.runs == ["a", "b", "c"]
    values = [difference.value for difference in figure(found, "grasp_quality").differences]
    assert values == pytest.approx([0.2, -0.05])


def test_frames_of_only_one_run_are_left_out_and_reported(tmp_path):
    paths = [write_run(tmp_path / "a", frames=5), write_run(tmp_path / "b", frames=3)]
    found = compare.run(paths, CONFIG)
    assert figure(found, "grasp_quality").frames == 6
    assert found.notes[0].startswith("The 2 runs are compared on 6 frames")
    assert found.notes[1] == "a: 4 of 10 frames left out, which not all runs contain."


def test_whole_scenes_are_drawn_unless_frames_are_requested(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", seed=1)]
    frames, scenes = (
        figure(compare.run(paths, replace(CONFIG, unit=unit)), "symmetry_ap rotation")
        for unit in ("frame", "scene")
    )
    assert frames.differences[0].value == scenes.differences[0].value
    assert frames.differences != scenes.differences
    by_default = compare.run(paths, CompareConfig(resamples=200))
    assert figure(by_default, "symmetry_ap rotation") == scenes
    assert (scenes.differences[0].units, frames.differences[0].units) == (2, 10)
    assert "over scenes" in compare.tables(by_default)[-1].note
    assert VIEWS_NOTE not in compare.tables(by_default)[-1].note
    assert VIEWS_NOTE in compare.tables(compare.run(paths, CONFIG))[-1].note
    with pytest.raises(UnknownNameError, match="unit"):
        compare.run(paths, replace(CONFIG, unit="object"))


def test_other_settings_and_labels_are_reported(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", gripper="franka", labels="b")]
    notes = " ".join(compare.run(paths, CONFIG).notes)
    assert "other settings: gripper franka instead of rg2" in notes
    assert "other labels: symmetry" in notes


def test_labels_of_runs_with_other_scenes_are_not_said_to_differ(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", scenes="b")]
    assert "b was evaluated on other labels: scenes." in compare.run(paths, CONFIG).notes
    (records_folder(paths[1]) / f"{min(SCENES)}.json").unlink()
    notes = compare.run(paths, CONFIG).notes
    assert not any("evaluated on other labels" in note for note in notes)
    assert notes[-1].startswith("b has other scenes than a, so whether labels of common scenes are")


def test_further_rows_of_a_report_are_no_other_labels(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", others=["gg-cnn"])]
    assert "labels" not in " ".join(compare.run(paths, CONFIG).notes)


def test_runs_on_other_objects_cannot_be_paired(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", objects=2)]
    with pytest.raises(SymgraspError, match="other visible objects"):
        compare.run(paths, CONFIG)


def test_a_method_without_symmetries_is_compared_by_the_other_figures(tmp_path):
    a, b = write_run(tmp_path / "a"), write_run(tmp_path / "b", better=0.1)
    for path in records_folder(b).iterdir():
        content = json.loads(path.read_text())
        for record in content["frames"]:
            record["rows"]["ours"]["symmetries"] = {}
        path.write_text(json.dumps(content))
    for paths in ([a, b], [b, a]):
        found = compare.run(paths, CONFIG)
        assert abs(figure(found, "grasp_quality").differences[0].value) == pytest.approx(0.1)
        metrics = {each.metric for each in found.figures}
        assert "mask_ap50" in metrics
        assert not any(metric.startswith("symmetry_ap") for metric in metrics)


def test_runs_without_a_common_frame_cannot_be_paired(tmp_path):
    first, second = write_run(tmp_path / "a"), write_run(tmp_path / "b")
    for path in records_folder(second).iterdir():
        path.write_text(path.read_text().replace("/kinect/", "/realsense/"))
    with pytest.raises(SymgraspError, match="no frame in common"):
        compare.run([first, second], CONFIG)


def test_records_of_another_run_than_the_report_are_refused(tmp_path):
    first, second = write_run(tmp_path / "a"), write_run(tmp_path / "b")
    scene = next(records_folder(second).iterdir())
    scene.write_bytes((records_folder(first) / scene.name).read_bytes())
    with pytest.raises(FormatError, match="made in another run"):
        compare.run([first, second], CONFIG)


def test_a_record_whose_lists_disagree_is_reported_in_one_sentence(tmp_path):
    first, second = write_run(tmp_path / "a"), write_run(tmp_path / "b")
    scene = next(records_folder(second).iterdir())
    content = json.loads(scene.read_text())
    content["frames"][0]["masks"]["confidence"].append(0.5)
    scene.write_text(json.dumps(content))
    with pytest.raises(FormatError, match="a record is not right"):
        compare.run([first, second], CONFIG)


def test_a_report_without_records_is_refused_with_the_command_that_writes_them(tmp_path):
    first, second = write_run(tmp_path / "a"), write_run(tmp_path / "b")
    records_folder(second).rename(tmp_path / "moved")
    with pytest.raises(MissingInputError, match="evaluate"):
        compare.run([first, second], CONFIG)


def test_the_same_report_twice_or_an_unknown_row_is_refused(tmp_path):
    first, second = write_run(tmp_path / "a"), write_run(tmp_path / "b")
    with pytest.raises(SymgraspError, match="twice"):
        compare.run([first, first], CONFIG)
    with pytest.raises(UnknownNameError, match="oracle"):
        compare.run([first, second], CompareConfig(row="oracle"))


@pytest.mark.parametrize("suffix", [".json", ".html"])
def test_a_written_comparison_is_reproducible_and_replaced_only_on_request(tmp_path, suffix):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", seed=3)]
    output = tmp_path / f"out{suffix}"
    compare.run(paths, CONFIG, output)
    written = output.read_bytes()
    compare.run(paths, CONFIG, output)
    assert output.read_bytes() == written
    with pytest.raises(StaleOutputError):
        compare.run(paths, CONFIG, output, seed=1)
    compare.run(paths, CONFIG, output, seed=1, overwrite=True)
    assert output.read_bytes() != written
    foreign = tmp_path / f"mine{suffix}"
    foreign.write_text("{}")
    with pytest.raises(SymgraspError, match="is no output of compare"):
        compare.run(paths, CONFIG, foreign, overwrite=True)


def test_a_page_of_a_killed_run_has_its_stamp(tmp_path, monkeypatch):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", better=0.1)]
    write = compare.write_text

    def killed(*given):
        write(*given)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(compare, "write_text", killed)
        with pytest.raises(KeyboardInterrupt):
            compare.run(paths, CONFIG, tmp_path / "c.html")
    compare.run(paths, CONFIG, tmp_path / "c.html")


def test_the_page_needs_no_network_and_the_file_is_plain_json(tmp_path):
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "<b>", better=0.1)]
    compare.run(paths, CONFIG, tmp_path / "c.html")
    page = (tmp_path / "c.html").read_text()
    assert "+0.100" in page
    assert "http" not in page
    assert "&lt;b&gt;" in page
    assert "<b>" not in page
    compare.run(paths, CONFIG, tmp_path / "c.json")
    content = json.loads((tmp_path / "c.json").read_text())
    found = content["figures"]["all"]["grasp_quality"]["differences"][0]
    assert found["value"] == pytest.approx(0.1)


def test_names_are_the_shortest_that_distinguish_runs():
    def names(*paths: str) -> list[str]:
        return compare.run_names([Path("/runs") / path for path in paths])

    assert names("a/report.json", "b/report.json") == ["a", "b"]
    assert names("one.json", "two.json") == ["one", "two"]
    assert names("x/a/1.json", "y/a/1.json") == ["x", "y"]
    assert names("a/1.json", "a/2.json", "b/1.json") == ["a/1", "a/2", "b/1"]
    assert names("report.json", "b/report.json") == ["runs", "b"]


def test_a_name_that_is_not_utf8_is_printed_as_in_a_url(tmp_path):
    odd = tmp_path / os.fsdecode(b"b\xff")
    paths = [write_run(tmp_path / "a"), write_run(tmp_path / "b", better=0.1).parent.rename(odd)]
    paths[1] /= "report.json"
    for suffix in (".html", ".json"):
        compare.run(paths, CONFIG, tmp_path / f"c{suffix}")
        assert "b%FF" in (tmp_path / f"c{suffix}").read_text(encoding="utf-8")


def test_tables_have_a_cell_for_every_head(tmp_path):
    paths = [write_run(tmp_path / name, seed=i) for i, name in enumerate("abc")]
    tables = compare.tables(compare.run(paths, CONFIG))
    assert [table.title.split(":")[0] for table in tables] == ["all", "seen", "novel"]
    assert all(len(row) == len(table.header) for table in tables for row in table.rows)


def write_dump_run(folder: Path, better: float = 0.0, exact: bool = False, **labels: str) -> Path:
    """Write a report by GraspNet's protocol, two cameras; accuracies are raised by `better`.

    `labels`: digests of the poses and meshes.
    """
    path, config = folder / "report.json", EvaluateDumpConfig(exact=exact)
    for camera in ("kinect", "realsense"):
        rng = np.random.default_rng(len(camera))
        accuracy = [rng.uniform(0.1, 0.5, (RANKS, len(AP_FRICTIONS))) + better for _ in range(6)]
        frames = [FrameVerdicts(i, "ok", "", 9, 0, 0, each) for i, each in enumerate(accuracy)]
        stamp = make_stamp("evaluate --protocol graspnet", config, inputs={"dump": camera})
        target = scenes_folder(path) / f"scene_0100_{camera}.npz"
        write_dump_verdicts(target, frames, stamp)
    inputs = {"dump": folder.name, **labels}
    stamp = make_stamp("evaluate --protocol graspnet", config, inputs=inputs)
    write_report(path, {"kinect": {}, "realsense": {}}, stamp, protocol="graspnet")
    return path


def test_dumps_are_compared_by_graspnets_ap(tmp_path):
    paths = [write_dump_run(tmp_path / "a"), write_dump_run(tmp_path / "b", better=0.1)]
    found = compare.run(paths, CONFIG)
    assert {figure.metric for figure in found.figures} == {"ap", "ap_0.8", "ap_0.4"}
    assert figure(found, "ap_0.4").differences[0].value == pytest.approx(0.1)
    assert figure(found, "ap").frames == 12
    assert found.notes == ["The 2 runs are compared on 12 frames that all contain."]
    one_camera = compare.run(paths, CompareConfig(row="kinect", resamples=10))
    assert figure(one_camera, "ap").frames == 6


def test_a_scene_of_no_split_counts_in_all_as_in_the_report(tmp_path):
    paths = [write_dump_run(tmp_path / name) for name in "ab"]
    for path in paths:
        for suffix in ("", ".provenance.json"):
            file = scenes_folder(path) / f"scene_0100_kinect.npz{suffix}"
            file.rename(file.with_name(file.name.replace("0100", "0250")))
    found = compare.run(paths, CONFIG)
    assert (figure(found, "ap").frames, figure(found, "ap", "seen").frames) == (12, 6)


def test_files_that_only_exact_verdicts_read_are_no_other_labels(tmp_path):
    first = write_dump_run(tmp_path / "a", poses="xml", meshes="grids")
    exact = write_dump_run(tmp_path / "b", exact=True, poses="xml and mat", meshes="surfaces")
    other = write_dump_run(tmp_path / "c", poses="xml", meshes="other grids")
    notes = compare.run([first, exact, other], CONFIG).notes
    assert notes[1:] == [
        "b was evaluated with other settings: exact True instead of False.",
        "c was evaluated on other labels: meshes.",
    ]


def test_the_ap_of_a_dump_is_that_of_its_report(tmp_path):
    path = write_dump_run(tmp_path / "a")
    totals = DumpTotals()
    for scene in sorted(scenes_folder(path).glob("*.npz")):
        totals.add(read_dump_verdicts(scene))
    found = compare.run([path, write_dump_run(tmp_path / "b")], CONFIG)
    for metric in ("ap", "ap_0.8", "ap_0.4"):
        assert figure(found, metric).values[0] == pytest.approx(totals.figures()[metric])


def test_a_dump_and_a_file_of_grasps_cannot_be_compared(tmp_path):
    paths = [write_run(tmp_path / "a"), write_dump_run(tmp_path / "b")]
    with pytest.raises(SymgraspError, match="different protocols"):
        compare.run(paths, CONFIG)


def test_runs_of_different_protocols_are_not_compared_even_if_both_have_an_ap(tmp_path):
    runs = [EvaluatedRun("a", {}), EvaluatedRun("b", {"protocol": "graspnet"})]
    for run in runs:
        run.add("scene/0", "seen", ((), 0, ()), 1, {"ap": 0.5})
    with pytest.raises(SymgraspError, match="different protocols"):
        compare.compared(runs, CONFIG, seed=0)


def write_trials_run(folder: Path, held: float, frictions=(0.3, 0.5), **options) -> Path:
    """Write a success.json with trials; about a share of `held` succeeds at friction 0.5.

    `options`: objects of a frame, frames of a scene, the method of the trials.
    """
    path = folder / "success.json"
    stamp = make_stamp("simulate", {"lift": 0.15}, inputs={"grasps": folder.name})
    keys, frames = [number_key(friction) for friction in frictions], []
    for scene, split in SCENES.items():
        found = []
        for i in range(options.get("frames", 5)):
            name = f"scenes/{scene.rsplit('_', 1)[0]}/kinect/{i:04d}"
            luck = np.random.default_rng(crc32(name.encode())).random(options.get("objects", 4))
            trials = [
                TrialRecord(j, "none", {
                    key: Outcome("held" if value < held * float(key) / 0.5 else "dropped")
                    for key in keys
                })
                for j, value in enumerate(luck)
            ]  # fmt: skip
            found.append(FrameTrials(name, split, 0.0, trials, {"random": trials[::-1]}))
        write_trials(trials_folder(path) / f"{scene}.json", found, stamp)
        frames += found
    write_success(path, frames, frictions, stamp)
    return path


def test_simulated_trials_are_compared_by_success_at_each_friction(tmp_path):
    paths = [write_trials_run(tmp_path / "a", 0.4), write_trials_run(tmp_path / "b", 0.9)]
    found = compare.run(paths, CONFIG)
    assert {figure.metric for figure in found.figures} == {"success 0.3", "success 0.5"}
    for place, path in enumerate(paths):
        for split, kinds in json.loads(path.read_text())["success"].items():
            for key, rate in kinds["all"].items():
                values = figure(found, f"success {key}", split).values
                assert values[place] == pytest.approx(rate["rate"])
    assert figure(found, "success 0.5").frames == 10
    assert figure(found, "success 0.5").differences[0].is_certain
    random = compare.run(paths, replace(CONFIG, row="random"))
    assert figure(random, "success 0.5").values == figure(found, "success 0.5").values
    tables = compare.tables(found)
    assert [row[0] for row in tables[0].rows] == ["success, mu 0.3", "success, mu 0.5"]


def test_runs_whose_frames_show_no_object_are_refused_in_a_sentence(tmp_path):
    runs = [write_trials_run(tmp_path / name, 0.5, objects=0) for name in ("a", "b")]
    with pytest.raises(SymgraspError, match="no figure is defined on the 10 frames"):
        compare.run(runs, CONFIG)


def test_the_interval_of_success_is_paired(tmp_path):
    same = [write_trials_run(tmp_path / name, 0.5) for name in "ab"]
    found = figure(compare.run(same, CONFIG), "success 0.5").differences[0]
    assert (found.low, found.high) == (0.0, 0.0)  # an object is equally hard for both runs


def test_trials_are_paired_at_common_frictions_on_common_frames(tmp_path):
    first = write_trials_run(tmp_path / "a", 0.5)
    second = write_trials_run(tmp_path / "b", 0.5, frictions=(0.5, 0.8), frames=3)
    found = compare.run([first, second], CONFIG)
    assert {figure.metric for figure in found.figures} == {"success 0.5"}
    assert figure(found, "success 0.5").frames == 6
    with pytest.raises(SymgraspError, match="different frictions"):
        compare.run([first, write_trials_run(tmp_path / "c", 0.5, frictions=(0.9,))], CONFIG)


def test_trials_that_cannot_be_paired_are_refused_in_a_sentence(tmp_path):
    first = write_trials_run(tmp_path / "a", 0.5)
    with pytest.raises(SymgraspError, match="other visible objects"):
        compare.run([first, write_trials_run(tmp_path / "b", 0.5, objects=2)], CONFIG)
    with pytest.raises(SymgraspError, match="no figure is common"):
        compare.run([first, write_run(tmp_path / "c")], CONFIG)
    with pytest.raises(UnknownNameError, match="oracle"):
        compare.run([first, first.with_name("x.json")], replace(CONFIG, row="oracle"))
    second = write_trials_run(tmp_path / "d", 0.5)
    trials_folder(second).rename(tmp_path / "moved")
    with pytest.raises(MissingInputError, match="symgrasp simulate"):
        compare.run([first, second], CONFIG)


def test_wrong_usage_and_bad_data_have_different_exit_codes(tmp_path):
    paths = [str(write_run(tmp_path / name)) for name in "ab"]
    assert CliRunner().invoke(app, ["compare", paths[0]]).exit_code == 2
    assert CliRunner().invoke(app, ["compare", *paths, "--out", "x.txt"]).exit_code == 2
    result = CliRunner().invoke(app, ["compare", *paths, "--resamples", "10"])
    assert result.exit_code == 0
    assert "grasp quality" in result.output
    records = next(records_folder(Path(paths[1])).iterdir())
    records.write_text("{}")
    assert CliRunner().invoke(app, ["compare", *paths]).exit_code == 1
