"""Every command keeps the conventions: the tests walk through all commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from pipelines import configs
from pipelines.configs.stages import STAGE_SETTINGS
from symgrasp_cli.app import COMMANDS, app
from tests.stages.test_infer import SHAPES, write_frame

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests" / "golden"
NAMES = [function.__name__.replace("_", "-") for function in COMMANDS]
GROUP = get_command(app)


def interface_of(name: str) -> str:
    """The command's text, options, defaults and help; typer alone decides on the layout."""
    command = GROUP if name == "symgrasp" else GROUP.commands[name]
    lines = [name, command.help.strip(), ""]
    for parameter in command.params:
        if getattr(parameter, "hidden", False):
            continue
        names = ", ".join([*parameter.opts, *parameter.secondary_opts])
        default = "required" if parameter.required else f"default {parameter.default!r}"
        lines.append(f"{names} ({default}): {parameter.help}")
    lines += [f"command {each}" for each in NAMES] if name == "symgrasp" else []
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", NAMES)
def test_every_command_and_every_option_has_help_that_ends_with_a_full_stop(name):
    command = GROUP.commands[name]
    assert command.help.strip().endswith(".")
    for parameter in command.params:
        if parameter.name != "help":
            text = getattr(parameter, "help", None)
            assert text, f"{name}: {parameter.name} has no help"
            assert text.endswith("."), f"{name}: {parameter.name}: {text!r}"


@pytest.mark.parametrize("name", STAGE_SETTINGS)
def test_every_stage_has_its_five_places(name):
    stem = COMMANDS[NAMES.index(name)].__module__.removeprefix("symgrasp_cli.")
    assert (ROOT / "symgrasp_cli" / f"{stem}.py").is_file()
    assert (ROOT / "pipelines" / f"{stem}.py").is_file()
    assert (ROOT / "tests" / "stages" / f"test_{stem}.py").is_file()
    config = "".join(part.title() for part in name.split("-")) + "Config"
    assert hasattr(configs, config)


def test_every_command_but_config_is_a_stage_with_settings():
    assert [name for name in NAMES if name != "config"] == list(STAGE_SETTINGS)


def test_commands_are_listed_in_workflow_order():
    text = CliRunner().invoke(app, ["--help"]).output
    places = [text.index(f" {name} ") for name in NAMES]
    assert places == sorted(places)


@pytest.mark.parametrize("name", NAMES)
def test_every_command_prints_its_help(name):
    assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0


@pytest.mark.parametrize("name", ["", *NAMES])
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help_is_complete_at_80_columns(name, option, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    text = CliRunner().invoke(app, [*([name] if name else []), option]).stdout
    assert "Usage" in text
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80


def test_the_shell_completes_commands_and_names_of_choices():
    options = [option for p in GROUP.params for option in p.opts]
    assert {"--install-completion", "--show-completion"} <= set(options)
    (rank_by,) = [p for p in GROUP.commands["infer"].params if "--rank-by" in p.opts]
    found = rank_by.shell_complete(None, "")
    assert [each.value for each in found] == ["critic", "eq8"]


@pytest.mark.parametrize("name", ["symgrasp", *NAMES])
def test_the_interface_equals_the_reviewed_golden_file(name, request):
    path = GOLDEN / f"help_{name}.txt"
    text = interface_of(name)
    if request.config.getoption("--golden"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert path.read_text(encoding="utf-8") == text


def test_help_needs_neither_torch_nor_numpy():
    code = (
        "import sys, symgrasp_cli.app; "
        "heavy = {'torch', 'numpy', 'cv2', 'h5py', 'scipy'} & set(sys.modules); "
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr


def test_wrong_usage_exits_with_2():
    assert CliRunner().invoke(app, ["infer"]).exit_code == 2


@pytest.mark.parametrize(
    "command",
    [
        "infer none --out out",
        "infer {frames} --out out --network none",
        "infer {frames} --out out --detector none",
        "inspect none",
        "convert-frames none --out out",
        "view none --out out",
        "export none --to json --out out",
        "simulate none --dataset {frames} --out out",
        "simulate {file} --dataset none --out out",
        "evaluate none --dataset {frames} --out out",
        "evaluate {file} --dataset none --out out",
        "compare {file} none",
        "train none --out out.safetensors",
        "train --endless none --val {frames} --out out.safetensors",
        "train {frames} --val none --out out.safetensors",
        "train {frames} --init none --out out.safetensors",
        "finetune-detector none --out out.safetensors",
        "pack none --out out",
        "export-coco none --out out",
        "annotate-symmetry none",
        "annotate-symmetry {frames} --edit none",
        "refine-grasps none",
        "label-grasps none --out out",
        "score-grasps none {file} --out out",
        "synthesize out --split train --models none",
    ],
)
def test_an_input_that_does_not_exist_is_wrong_usage(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frames").mkdir()
    (tmp_path / "file").touch()
    result = CliRunner().invoke(app, command.format(frames="frames", file="file").split())
    assert (result.exit_code, type(result.exception)) == (2, SystemExit), result.output
    assert "none" in result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "frames"]


@pytest.mark.parametrize(
    "options",
    [
        ["--intrinsics", "300,300"],
        ["--intrinsics", "0,0,0,0"],
        ["--intrinsics", "600,600,abc,4"],
        ["--approach-cone", "-5"],
        ["--approach-direction", "up"],
        ["--workspace", "0,0,0"],
        ["--workspace", "0,0,0,-1,1,1"],
        ["--depth-units-per-metre", "0"],
        ["--method", "foo"],
        ["--regions", "foo"],
        ["--gripper", "nohand"],
        ["--backend", "foo"],
        ["--regions", "geometric", "--device", "foo"],
        ["--regions", "geometric", "--device", "cpu:1"],
        ["--regions", "geometric", "--device", "cuda:01"],
        ["--masks", "no/folder"],
        ["--workspace-frame", "table"],
    ],
)
def test_impossible_values_are_wrong_usage(options, tmp_path):
    frames = str(ROOT / "pipelines/weights/frames")
    command = ["infer", frames, "--out", str(tmp_path / "g.h5"), "--method", "planar", *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert not (tmp_path / "g.h5").exists()


def test_an_output_that_the_system_refuses_is_reported_in_one_sentence(tmp_path):
    (tmp_path / "file").write_text("no folder")
    frames, output = tmp_path / "frames", tmp_path / "file" / "g.h5"
    write_frame(frames, "a", SHAPES["a"])
    command = ["infer", str(frames), "--out", str(output), "--method", "planar"]
    result = CliRunner().invoke(app, [*command, "--regions", "geometric"])
    assert result.exit_code == 1
    last = result.stderr.splitlines()[-1]  # a message about compiling loops may come first
    assert last.startswith("error: ")
    assert "file" in last


def test_a_torchvision_of_another_torch_is_reported_in_one_sentence(tmp_path):
    package = tmp_path / "torchvision"
    package.mkdir()
    fault = "operator torchvision::nms does not exist"
    (package / "__init__.py").write_text(f"raise RuntimeError({fault!r})\n")
    frames = ROOT / "pipelines" / "weights" / "frames"
    command = "from symgrasp_cli.main import main; main()"
    result = subprocess.run(
        [sys.executable, "-c", command, "infer", str(frames), "--out", str(tmp_path / "g.h5")],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    assert "was built for another torch" in result.stderr
    assert "pip install --force-reinstall torch torchvision" in result.stderr
    assert not (tmp_path / "g.h5").exists()
