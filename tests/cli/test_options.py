"""Options of the command line as options of a batch."""

from pathlib import Path

import joblib
import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

from pipelines.health import machine
from pipelines.runtime.batch import CHOSEN
from symgrasp_cli.app import app
from symgrasp_cli.arguments import preparation, run_on_cpu

FRAMES = Path(__file__).resolve().parents[2] / "pipelines" / "weights" / "frames"


@pytest.fixture(autouse=True)
def four_cores(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 4)


@pytest.mark.parametrize(
    ("backend", "workers", "used"), [("loky", 4, 4), ("loky", 100, 4), ("dask", 100, 100)]
)
def test_no_more_processes_than_cores_are_started_on_this_machine(caplog, backend, workers, used):
    options = preparation(workers, backend)
    assert options.workers == used
    expected = [f"--workers {workers} is more than this machine's 4 cores: 4 work at a time"]
    assert [record.getMessage() for record in caplog.records] == expected * (used < workers)


@pytest.mark.parametrize(("threads", "used"), [(1, 1), (4, 4), (1000, 4)])
def test_a_training_has_no_more_threads_than_cores(caplog, threads, used):
    assert run_on_cpu(threads=threads).threads == used
    expected = [f"--threads {threads} is more than this machine's 4 cores: 4 work at a time"]
    assert [record.getMessage() for record in caplog.records] == expected * (used < threads)


@pytest.mark.parametrize(("free", "used"), [(9e9, 4), (2.5e9, 2), (1e8, 1), (None, 4)])
def test_without_a_number_there_are_as_many_workers_as_cores_and_memory_allow(
    monkeypatch, free, used
):
    monkeypatch.setattr(machine, "free_memory", lambda: free)
    assert preparation().workers == used


def test_infer_chooses_its_workers_itself():
    options = preparation(CHOSEN)
    assert options.workers == CHOSEN


@pytest.mark.parametrize(
    ("variable", "option"),
    [
        ("SYMGRASP_WORKERS", "--workers"),
        ("SYMGRASP_BACKEND", "--backend"),
        ("SYMGRASP_DEVICE", "--device"),
        ("SYMGRASP_GRIPPER", "--gripper"),
    ],
)
def test_options_that_people_set_once_may_be_environment_variables(variable, option):
    (found,) = [p for p in get_command(app).commands["infer"].params if option in p.opts]
    assert found.envvar == variable


def test_a_variable_is_used_unless_the_option_is_given(tmp_path):
    command = ["infer", str(FRAMES), "--out", str(tmp_path / "g.h5"), "--method", "planar"]
    runner = CliRunner(env={"SYMGRASP_BACKEND": "none"})
    assert "backend 'none' is not known" in runner.invoke(app, command).stderr
    result = runner.invoke(app, [*command, "--backend", "loky", "--dry-run"])
    assert result.exit_code == 0, result.stderr


def test_a_time_limit_is_in_seconds_and_its_old_name_in_minutes():
    assert run_on_cpu(max_seconds=90.0).max_seconds == 90.0
    assert run_on_cpu(max_minutes=1.5).max_seconds == 90.0
    assert run_on_cpu().max_seconds is None


def test_two_time_limits_are_wrong_usage():
    with pytest.raises(typer.BadParameter, match="give one of them"):
        run_on_cpu(max_seconds=90.0, max_minutes=1.5)


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("infer . --weights x.safetensors", "--weights goes with a compared --method"),
        ("train . --out n.safetensors --endless-share 0.7", "0.7 goes with --endless ROOT"),
        ("train . --out n.safetensors --set endless.share=0.7", "0.7 goes with --endless ROOT"),
        ("train --endless . --out n.safetensors --endless-share 0.3", "0.3 goes with PACKED"),
        ("train . --out n.safetensors --workers 2", "--workers 2 goes with --endless ROOT"),
        (
            "evaluate . --dataset . --protocol graspnet --unit frame --gripper rg2",
            "the settings gripper, unit: no effect with --protocol graspnet",
        ),
        (
            "evaluate . --dataset . --protocol graspnet --min-visible-pixels 9",
            "the setting min_visible_pixels: no effect with --protocol graspnet",
        ),
        (
            "evaluate x.safetensors --dataset . --set graspnet.clip_width=0.05",
            "the setting graspnet.clip_width: no effect with --protocol symgrasp",
        ),
    ],
)
def test_an_option_without_effect_is_wrong_usage(command, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.safetensors").touch()
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 2
    assert sentence in " ".join(result.stderr.replace("│", " ").split())
    assert [path.name for path in tmp_path.iterdir()] == ["x.safetensors"]


@pytest.mark.parametrize(
    "command",
    [
        "compare a.json b.json --out b.json",
        "compare a.json b.json --out link.json",
        "evaluate g.h5 --dataset . --out a.json --success a.json",
        "evaluate g.h5 --dataset . --out a.json --table a.json",
    ],
)
def test_an_output_that_is_an_input_is_refused_even_with_overwrite(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.json", "b.json", "g.h5"):
        (tmp_path / name).write_text("{}")
    (tmp_path / "link.json").symlink_to("b.json")
    result = CliRunner().invoke(app, [*command.split(), "--overwrite"])
    assert result.exit_code == 2
    assert "another file than the files that are read" in " ".join(result.stderr.split())
    assert (tmp_path / "a.json").read_text() == (tmp_path / "b.json").read_text() == "{}"


@pytest.mark.parametrize("number", ["inf", "nan", "1e300", "-1"])
@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("workspace . --margin={}", "--margin is {}; it must be a number in m from 0 to 10"),
        ("gripper from-urdf g.urdf --out g.toml --tip-reach={}", "--tip-reach is {}"),
        ("gripper from-urdf g.urdf --out g.toml --clearance={}", "--clearance is {}"),
        ("serve --set http.grace={}", "http.grace is "),
        ("annotate-symmetry . --out new --mesh-scale={}", "Invalid value for '--mesh-scale'"),
    ],
)
def test_a_number_without_bounds_is_wrong_usage(command, sentence, number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, command.format(number).split())
    assert result.exit_code == 2
    shown = sentence.format(float(number))
    assert shown in " ".join(result.stderr.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_a_seed_that_no_generator_takes_is_wrong_usage(tmp_path):
    command = ["infer", str(tmp_path), "--out", str(tmp_path / "g.h5"), "--seed", str(2**64)]
    assert CliRunner().invoke(app, command).exit_code == 2
