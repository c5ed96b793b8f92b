"""`evaluate` on a dataset whose truth is known."""

from pathlib import Path

import numpy as np
import pytest

from pipelines import evaluate
from pipelines.batch import BatchOptions, StageReport
from pipelines.configs import EvaluateConfig
from pipelines.errors import StaleOutputError
from pipelines.evaluation.records import read_records
from pipelines.formats import reports
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.grasps_file import FrameResult
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
    baselines = options.pop("baselines", False)
    return evaluate.run(
        grasps,
        root.root,
        output,
        EvaluateConfig(min_visible_pixels=100),
        BatchOptions(progress=False, **options),
        baselines=baselines,
    )


def figures(output: Path, row: str = "ours", split: str = "all") -> dict:
    return reports.read_report(output)["rows"][row][split]


@pytest.fixture(scope="module")
def truth_report(root, truth_file, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("report") / "report.json"
    assert run(truth_file, root, output, baselines=True).exit_code == 0
    return output


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


def test_scenes_count_in_their_split(truth_report):
    counted = {s: figures(truth_report, split=s)["frames"] for s in ("seen", "similar", "novel")}
    assert counted == {"seen": 2, "similar": 0, "novel": 2}
    assert figures(truth_report)["objects"] == 12


def test_a_split_without_frames_has_no_figures(truth_report):
    found = figures(truth_report, split="similar")
    assert found["grasp_quality"] is None
    assert found["symmetry_ap"]["sphere"] is None


def test_the_oracle_holds_objects_and_chance_does_no_better(truth_report):
    oracle = figures(truth_report, "oracle")
    assert oracle["grasp_quality"] > 0.5
    assert oracle["symmetry_ap"] == {"reflection": 1.0, "rotation": 1.0, "sphere": 1.0}
    assert figures(truth_report, "random")["grasp_quality"] <= oracle["grasp_quality"]
    assert figures(truth_report, "planar")["symmetry_ap"]["reflection"] is None


def test_the_page_holds_the_tables_and_needs_no_network(truth_report):
    page = truth_report.with_suffix(".html").read_text()
    assert "oracle" in page
    assert "http" not in page


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


def test_a_second_run_judges_nothing_again_and_an_interrupted_one_only_the_rest(
    root, truth_file, tmp_path
):
    output = tmp_path / "report.json"
    assert len(run(truth_file, root, output).done) == len(SCENES)
    whole = output.read_bytes()
    assert run(truth_file, root, output).done == []
    records = sorted(evaluate.records_folder(output).iterdir())
    records[0].unlink()
    output.unlink()
    assert run(truth_file, root, output).done == [records[0].stem]
    assert output.read_bytes() == whole


def test_a_report_of_other_grasps_is_not_replaced_unasked(root, truth_file, tmp_path):
    output = tmp_path / "report.json"
    run(truth_file, root, output)
    write_grasps(tmp_path / "g.h5", [true_result(root, name, (0,)) for name in frame_names()])
    with pytest.raises(StaleOutputError, match="--overwrite"):
        run(tmp_path / "g.h5", root, output)
    run(tmp_path / "g.h5", root, output, overwrite=True)
    assert figures(output)["reasons"]["no region"] == 8


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


def test_a_dry_run_writes_nothing(root, truth_file, tmp_path):
    report = run(truth_file, root, tmp_path / "report.json", dry_run=True)
    assert len(report.notes) == len(SCENES)
    assert list(tmp_path.iterdir()) == []


def test_records_read_as_they_were_written(truth_report):
    folder = evaluate.records_folder(truth_report)
    frames = [record for path in sorted(folder.iterdir()) for record in read_records(path)]
    assert [frame.name for frame in frames] == frame_names()
    assert {row for frame in frames for row in frame.rows} == {
        "ours", "oracle", "planar", "random",
    }  # fmt: skip
    worst = [v.min_friction for f in frames for row in f.rows.values() for v in row.verdicts]
    assert all(isinstance(value, float) and not np.isnan(value) for value in worst)
