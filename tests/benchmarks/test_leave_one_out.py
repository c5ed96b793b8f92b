"""The leave-one-out driver: its rules, its memory, its restart, and the table."""

import math
from pkgutil import resolve_name

import numpy as np
import pytest

from benchmarks import leave_one_out
from benchmarks.leave_one_out import Memory, left_out, measure, page, rule_differences
from benchmarks.rules import (
    EVERY_RULE,
    RULES,
    Rule,
    axes_without,
    departures,
    planes_without_axis_point,
    rules_named,
)
from pipelines.compare import Figure
from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.configs.presets import preset_settings
from pipelines.configs.settings import changed
from pipelines.errors import UnknownNameError
from pipelines.evaluation.reports.figures import report_rows
from pipelines.evaluation.reports.reports import write_report
from pipelines.evaluation.runs.records import (
    FrameRecord,
    RowRecord,
    ScoredPredictions,
    records_folder,
    write_frame_records,
)
from pipelines.evaluation.runs.tallies import ReportTally
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping import planner
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.axis_candidates import starting_axes
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.metrics.paired_bootstrap import Difference
from pipelines.runtime.batch import StageReport
from pipelines.storage.provenance import make_stamp


@pytest.mark.parametrize("rule", RULES[1:], ids=lambda rule: rule.key)
def test_each_rule_changes_settings_or_replaces_names_of_the_code(rule):
    assert rule.settings or rule.replaced
    if rule.settings:
        assert changed(InferConfig(), rule.settings) != InferConfig()
    for name in rule.replaced:
        resolve_name(name)


def test_every_key_is_unique_and_every_base_is_a_rule():
    keys = [rule.key for rule in RULES]
    assert len(set(keys)) == len(keys)
    assert {rule.base for rule in RULES} <= set(keys)


def test_a_named_rule_brings_the_rules_it_is_compared_with():
    assert [rule.key for rule in rules_named(["eq8-unseen"])] == [EVERY_RULE, "eq8", "eq8-unseen"]
    assert rules_named([]) == RULES
    with pytest.raises(UnknownNameError, match="no-such"):
        rules_named(["no-such"])


def test_a_replaced_constant_is_restored_afterwards():
    rule = Rule("off-centre", "", replaced={"pipelines.grasping.planner.OFF_CENTER": 0.0})
    before = planner.OFF_CENTER
    with left_out(rule, Memory()):
        assert planner.OFF_CENTER == 0.0
    assert before == planner.OFF_CENTER


def test_a_result_is_computed_once_for_equal_arguments_and_scope():
    calls = []

    def double(values, factor):
        calls.append(factor)
        return factor * values

    memory = Memory()
    remembered, other = memory.remembering(double), memory.remembering(double, "other")
    assert (remembered(np.arange(3), 2) == remembered(np.arange(3), 2)).all()
    assert (remembered(np.arange(3), 3) == [0, 3, 6]).all()
    assert (remembered(np.arange(3.0), 2) == [0, 2, 4]).all()
    assert (other(np.arange(3), 2) == [0, 2, 4]).all()
    assert calls == [2, 3, 2, 2]


def test_finished_folders_are_not_processed_again(monkeypatch, tmp_path):
    done = []

    def run(paths, config, options):
        del config, options
        done.append(paths.frames)
        paths.output.write_bytes(b"")
        return StageReport("infer")

    monkeypatch.setattr(leave_one_out.infer, "run", run)
    for folder in ([tmp_path / "one"], [tmp_path / "one", tmp_path / "two"]):
        measure(RULES[0], folder, tmp_path / "out", Memory())
    assert done == [tmp_path / "one", tmp_path / "two"]


def test_the_figures_of_a_rule_are_over_all_datasets_together(tmp_path):
    datasets = []
    for number in (100, 160):
        record = FrameRecord(
            f"scenes/scene_{number:04d}/kinect/0000",
            "seen",
            0.1,
            ScoredPredictions(0),
            {"ours": RowRecord([Verdict(0, "held", number / 200)])},
        )
        stamp, report = (
            make_stamp("evaluate", EvaluateConfig()),
            tmp_path / "all" / f"{number}.json",
        )
        write_frame_records(records_folder(report) / "scene.json", [record], stamp)
        write_report(report, report_rows(ReportTally.of([record]), (0.25,), 0.05), stamp)
        datasets.append(tmp_path / str(number))
    figures = rule_differences(RULES[:1], datasets, tmp_path)[EVERY_RULE]
    (quality,) = (each for each in figures if each.metric == "grasp_quality")
    assert (quality.frames, quality.values) == (2, [0.65, 0.65])


def test_the_table_shows_figures_of_all_rules_then_differences_with_intervals():
    def figure(value):
        difference = Difference(value, value - 0.002, value + 0.001, 24)
        return Figure("grasp_quality", "all", 24, [0.7, 0.7 + value], [difference])

    same = Figure("grasp_quality", "all", 24, [0.7, 0.7], [Difference(0.0, 0.0, 0.0, 24)])
    alone = [Difference(0.02, math.nan, math.nan, 1)]
    one_scene = Figure("antipodal_score", "all", 24, [0.7, 0.72], alone)
    found = {EVERY_RULE: [figure(0.0)], "off-centre": [figure(-0.01)], "stray": [same, one_scene]}
    lines = page(RULES, found).splitlines()
    assert any(line.startswith("| all | nothing | 0.700 | - |") for line in lines)
    assert any("| -0.0100 (-0.012 to -0.009) |" in line for line in lines)
    assert any(line.startswith("| stray |") and "| same | +0.0200 |" in line for line in lines)


def test_the_departures_together_are_the_preset_of_the_paper():
    alone = {name: value for rule in departures() for name, value in rule.settings.items()}
    assert changed(InferConfig(), alone) == changed(
        InferConfig(), preset_settings("paper", "infer")
    )


def test_left_out_candidates_are_missing_from_the_proposals():
    points, normals = np.random.default_rng(0).normal(size=(2, 60, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    slots = SymmetrySlots.of(())
    slots.probability[:], slots.point[:], slots.direction[:] = 1.0, 0.0, [0.0, 0.0, 1.0]
    scene = SceneCloud(np.zeros((48, 64)), Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48), None)
    region = RegionEvidence(slots, points, normals, scene.depth > 0, scene)
    every, sources = starting_axes(region)
    fewer, kept = axes_without([0])(region)
    assert [axis.direction.tolist() for axis in fewer] == [
        axis.direction.tolist() for axis in every[1:]
    ]
    np.testing.assert_array_equal(kept, sources[1:])
    planes, origins = planes_without_axis_point(slots, every[0], points, normals, None)
    assert len(planes) == len(origins)
