"""Reports: tables that fit, sentences for people on stderr, JSON on stdout."""

import json

import pytest
import typer
from typer.testing import CliRunner

from pipelines import annotate_symmetry
from pipelines.configs import SimulateConfig
from pipelines.evaluation.reports.tables import Table
from pipelines.runtime.batch import StageReport
from symgrasp_cli.app import app
from symgrasp_cli.report import ReportStyle, conclude, reporting_in, show_table
from symgrasp_cli.simulate import shared_options

HEADER = ("method", "mu", "split", "reflection", "rotation", "sphere", "none", "all")
RATES = ("66 (58-72)", "73 (67-79)", "100 (76-100)", "75 (55-88)", "71 (66-75)")
TABLE = Table("Table III", HEADER, (("SymGrasp", "0.5", "similar", *RATES),), names=3)


@pytest.mark.parametrize(("columns", "gap"), [(80, " "), (120, "  ")])
def test_a_row_stays_on_its_line(monkeypatch, capsys, columns, gap):
    monkeypatch.setenv("COLUMNS", str(columns))
    show_table(TABLE)
    assert gap.join(["SymGrasp", "0.5", "similar", *RATES]) in capsys.readouterr().out


def test_a_pipe_is_as_wide_as_the_table(monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    row = ("a name of a run that is as long as names of runs are", "0.5", "similar", *RATES)
    show_table(Table("Table III", HEADER, (row,), names=3))
    assert "  ".join(row) in capsys.readouterr().out


def reported(capsys, tmp_path, report, wanted=None, **more):
    """Return the stdout and stderr of `conclude`, and the exit code."""
    (tmp_path / "out file").touch()
    code = 0
    with reporting_in(wanted or ReportStyle()):
        try:
            conclude(report, tmp_path / "out file", tmp_path / "missing", None, **more)
        except typer.Exit as end:
            code = end.exit_code
    return (*capsys.readouterr(), code)


def test_a_report_names_counts_the_output_and_the_next_command(capsys, tmp_path):
    report = StageReport("infer", done=["a"], skipped=["b"], notes={"a": "odd"}, seconds=1.23)
    then = ("view", tmp_path / "out file")
    out, err, code = reported(capsys, tmp_path, report, then=then, lines=["2 grasps"])
    assert (out, code) == ("", 0)
    assert err.splitlines() == [
        "a: odd",
        "infer: 1 done, 1 skipped as finished, 0 failed, 1.2 s",
        "2 grasps",
        f"output: {tmp_path / 'out file'}",
        f"next: symgrasp view '{tmp_path / 'out file'}'",
    ]


@pytest.mark.parametrize("out", ["symmetry", "elsewhere"])
def test_labels_are_refined_next_only_where_their_symmetries_are(tmp_path, monkeypatch, out):
    for folder in ("grasp_label", out):
        (tmp_path / folder).mkdir()
    report = StageReport("annotate-symmetry", ["000"])
    monkeypatch.setattr(annotate_symmetry, "run", lambda *_, **__: report)
    arguments = ["annotate-symmetry", str(tmp_path), "--out", str(tmp_path / out)]
    result = CliRunner().invoke(app, arguments)
    assert ("next: symgrasp refine-grasps" in result.stderr) == (out == "symmetry")


def test_evaluate_is_next_after_trials_with_the_settings_that_decide_on_their_objects():
    assert shared_options(SimulateConfig(frictions=(0.5,))) == ()
    config = SimulateConfig(min_visible_pixels=100, min_region_share=0.4, gripper="franka")
    chosen = ["min_visible_pixels=100", "min_region_share=0.4", "gripper=franka"]
    assert [*shared_options(config)] == [word for each in chosen for word in ("--set", each)]


def test_no_next_command_is_named_where_nothing_is_finished(capsys, tmp_path):
    report = StageReport("infer", failed={"b": "it is bad"})
    _, err, code = reported(capsys, tmp_path, report, then=("view",))
    assert code == 1
    assert "error: b: it is bad" in err
    assert "next:" not in err


def test_no_next_command_is_named_that_would_be_refused(capsys, tmp_path):
    report = StageReport("pack", done=["a"], has_next=False)
    assert "next:" not in reported(capsys, tmp_path, report, then=("train",))[1]


def test_no_next_command_is_named_before_there_is_an_output(capsys, tmp_path):
    """A training may stop at its time limit before it has weights."""
    report = StageReport("train", done=["a"])
    conclude(report, tmp_path / "missing", then=("infer",))
    assert "next:" not in capsys.readouterr().err


def test_a_quiet_command_reports_failures_only(capsys, tmp_path):
    report = StageReport("infer", done=["a"], failed={"b": "it is bad"}, notes={"a": "odd"})
    _, err, _ = reported(capsys, tmp_path, report, ReportStyle(quiet=True), lines=["2 grasps"])
    assert err == "error: b: it is bad\n"


def test_many_failures_of_one_cause_are_one_sentence_and_all_names(capsys, tmp_path):
    names = [f"root/scene_{number:04d}" for number in range(5)]
    failed = {name: f"rows/{name}.h5 was made with other settings" for name in names}
    failed |= {"odd": "it is bad"} | {f"few_{i}": f"rows/few_{i}.h5 is cut off" for i in range(3)}
    _, err, _ = reported(
        capsys, tmp_path, StageReport("pack", failed=failed), ReportStyle(quiet=True)
    )
    assert err.splitlines() == [
        f"error: {names[0]}: rows/{names[0]}.h5 was made with other settings",
        f"error: 4 more for the same reason: {', '.join(names[1:])}",
        "error: odd: it is bad",
        *(f"error: few_{i}: rows/few_{i}.h5 is cut off" for i in range(3)),
    ]


def test_a_json_report_is_one_object_with_its_tables(capsys, tmp_path):
    report = StageReport("infer", done=["a"], failed={"b": "it is bad"}, seconds=1.23)
    out, _, _ = reported(
        capsys, tmp_path, report, ReportStyle(as_json=True), tables=[TABLE], facts={"grasps": 2}
    )
    found = json.loads(out)
    assert found | {"tables": []} == {
        "command": "infer",
        "ok": False,
        "done": ["a"],
        "skipped": [],
        "failed": {"b": "it is bad"},
        "notes": {},
        "seconds": 1.23,
        "outputs": [str(tmp_path / "out file")],
        "next": None,
        "tables": [],
        "grasps": 2,
    }
    assert found["tables"][0]["header"] == list(HEADER)


def test_a_command_that_ends_with_an_error_reports_the_error_as_json_too(tmp_path):
    arguments = ["inspect", str(tmp_path), "--json"]
    result = CliRunner().invoke(app, arguments)
    found = json.loads(result.stdout)
    assert (found["command"], found["ok"]) == ("inspect", False)
    assert f"error: {found['error']}\n" == result.stderr


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["inspect", "no_folder"], "Invalid value for 'frames': path 'no_folder' does not exist."),
        (["inspect"], "Missing argument"),
        (["-v", "infer", ".", "--nope"], "No such option: --nope"),
        (["compare", __file__], "one report has nothing to be compared with; give two or more"),
        (["config", "nope"], "stage 'nope' is not known"),
        (["nope"], "No such command 'nope'."),
        (["--nope", "infer"], "No such option: --nope"),
        (["gripper"], "Missing argument 'task'. Choose from: from-urdf, check"),
    ],
)
def test_wrong_usage_is_reported_as_json_too(arguments, sentence):
    result = CliRunner().invoke(app, [*arguments, "--json"])
    found = json.loads(result.stdout)
    assert (found["command"], found["ok"]) == (arguments[arguments[0].startswith("-")], False)
    assert sentence.lower() in found["error"].lower()
    assert result.exit_code == 2
    assert not CliRunner().invoke(app, arguments).stdout
