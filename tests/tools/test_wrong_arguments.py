"""Scripts of the project end in one sentence, without a traceback, when arguments are wrong."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines.errors import SymgraspError, errors_as_sentences
from pipelines.inference.models import NETWORK_WEIGHTS
from pipelines.storage.files import write_json
from tools import robustness

ROOT = Path(__file__).parents[2]
WRONG = {
    "tools/average_weights": "none --out {out}",
    "tools/controls": "true-regions {out} none",
    "tools/network_figures": f"none {NETWORK_WEIGHTS}",
    "tools/peer_oracle": "graspnet none {out}",
    "tools/possible_grasps": "none.json none",
    "tools/robustness": "none {out}",
    "tools/row_costs": "none",
    "tools/score_reliability": "none.h5 none",
    "tools/true_depth": "none {out}",
    "benchmarks/baseline_oracles": "none",
    "benchmarks/leave_one_out": "none --out {out}",
}


def ending_of(script, arguments, monkeypatch, capsys):
    """Return the exit code of `script` and its lines on stderr."""
    path = ROOT / f"{script}.py"
    monkeypatch.setattr(sys, "argv", [str(path), *arguments])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    return ended.value.code, capsys.readouterr().err.splitlines()


@pytest.mark.parametrize("script", WRONG)
def test_a_missing_input_is_reported_in_one_sentence(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = WRONG[script].format(out="out").split()
    code, lines = ending_of(script, arguments, monkeypatch, capsys)
    assert code == 1
    (line,) = lines
    assert line.startswith("error: ")
    assert "none" in line
    assert not (tmp_path / "none").exists()


def test_a_file_that_is_no_report_is_refused(tmp_path, monkeypatch, capsys):
    report = tmp_path / "some.json"
    write_json(report, {"a": 1})
    arguments = [str(report), "none"]
    assert ending_of("tools/possible_grasps", arguments, monkeypatch, capsys) == (
        1,
        [f"error: {report}: is no report; a report.json of `symgrasp evaluate` is expected"],
    )


def test_a_stride_of_zero_is_refused(monkeypatch, capsys):
    code, lines = ending_of(
        "tools/score_reliability", ["none.h5", "none", "0"], monkeypatch, capsys
    )
    assert (code, lines) == (1, ["error: STRIDE is 0; it must be at least 1"])


def test_an_argument_that_is_left_out_is_wrong_usage(monkeypatch, capsys):
    code, lines = ending_of("benchmarks/baseline_oracles", [], monkeypatch, capsys)
    assert code == 2
    assert lines[-1].endswith("the following arguments are required: root")


def test_a_command_that_fails_ends_the_robustness_curves(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        robustness.run("infer", tmp_path, "--no-such-option")
    assert ended.value.code == 2
    assert "--no-such-option" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        robustness.run("infer", tmp_path, "--out", tmp_path / "grasps.h5")
    assert ended.value.code == 1


@pytest.mark.parametrize("name", ["make_tables.sh", "make_weights.sh"])
@pytest.mark.parametrize("arguments", [[], [""]])
def test_a_shell_script_without_a_folder_shows_its_usage(arguments, name, tmp_path):
    command = ["sh", ROOT / "tools" / name, *arguments]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode != 0
    (line,) = ended.stderr.splitlines()
    assert f"usage: tools/{name} FOLDER" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [SymgraspError("a"), OSError("a")])
def test_an_error_that_a_user_can_fix_ends_the_program_with_its_sentence(error, capsys):
    with pytest.raises(SystemExit) as ended, errors_as_sentences():
        raise error
    assert ended.value.code == 1
    assert capsys.readouterr().err == "error: a\n"


def test_all_other_errors_keep_their_traceback():
    with pytest.raises(ZeroDivisionError), errors_as_sentences():
        _ = 1 / 0


def test_every_script_with_arguments_reports_its_errors_in_a_sentence():
    files = [file for name in ("tools", "benchmarks") for file in (ROOT / name).rglob("*.py")]
    texts = {file: file.read_text(encoding="utf-8") for file in files}
    parsing = {file for file, text in texts.items() if "ArgumentParser(" in text}
    assert len(parsing) > 20
    # The ablations have their own boundary, which returns the code.
    ending = {file for file in parsing if "errors_as_sentences()" in texts[file]}
    assert [file.name for file in parsing - ending] == ["ablations.py"]
