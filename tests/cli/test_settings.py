"""Settings on the command line: `--config`, `--set`, variables, options, their precedence."""

import json

import numpy as np
import pytest
import trimesh
from typer.main import get_command
from typer.testing import CliRunner

from pipelines.configs.settings import settings_of
from pipelines.configs.stages import STAGE_SETTINGS, default_settings
from pipelines.storage.images import write_image
from pipelines.storage.provenance import read_stamp
from symgrasp_cli.app import app
from symgrasp_cli.settings import PANEL, GivenOption, SettingOption, settings_chosen


def run(*arguments):
    return CliRunner().invoke(app, [str(each) for each in arguments])


def given(names, name, value, *, by_variable=False):
    setting = {each.name: each for each in settings_of(default_settings("infer"))}[name]
    return GivenOption(SettingOption(names, setting, "SYMGRASP_X"), value, by_variable)


@pytest.fixture
def scored(tmp_path):
    """Arguments of the quickest stage that stamps its output."""
    trimesh.creation.box((0.04, 0.04, 0.04)).export(tmp_path / "box.ply")
    row = [0.5, 0.06, 0.02, 0.02, *np.eye(3).ravel(), 0, 0, 0, -1]
    np.save(tmp_path / "grasps.npy", np.array([row]))
    return [
        "score-grasps",
        tmp_path / "box.ply",
        tmp_path / "grasps.npy",
        "--out",
        tmp_path / "s.npz",
    ]


def test_a_setting_changed_by_set_changes_the_stamp(scored, tmp_path):
    assert run(*scored).exit_code == 0
    assert read_stamp(tmp_path / "s.npz")["config"]["clip_width"] == 0.1
    refused = run(*scored, "--set", "clip_width=0.08")
    assert refused.exit_code == 1
    assert "made with other settings" in refused.stderr
    assert run(*scored, "--set", "clip_width=0.08", "--overwrite").exit_code == 0
    assert read_stamp(tmp_path / "s.npz")["config"]["clip_width"] == 0.08
    assert "1 skipped" in run(*scored, "--clip-width", "0.08").stderr


def test_a_misspelt_setting_is_wrong_usage_and_the_nearest_name_is_suggested(scored, tmp_path):
    result = run(*scored, "--set", "clip_widht=0.08")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: --set: setting 'clip_widht' is not known")
    assert "the nearest is 'clip_width'" in result.stderr
    assert not (tmp_path / "s.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--set", "clip_width"], "NAME=VALUE"),
        (["--set", "clip_width=wide"], "--set: clip_width is 'wide'; it must be a number"),
        (["--clip-width", "7"], "--clip-width is 7.0; it must be a number in m from 0.001 to 1"),
        (["--clip-width", "0.1", "--set", "clip_width=0.1"], "given with --clip-width"),
        (["--clip-width", "0.1", "--set", "max_width=0.1"], "given with --clip-width"),
        (["--set", "clip_width=0.1", "--set", "max_width=0.1"], "given with --set clip_width"),
        (["--clip-width", "0.1", "--max-width", "0.08"], "--max-width is given with --clip-width"),
        (["--config", "bad.toml"], "bad.toml: setting 'clipwidth' is not known"),
        (["--config", "none.toml"], "none.toml"),
    ],
)
def test_wrong_settings_are_reported_in_one_sentence(
    scored, tmp_path, monkeypatch, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text("clipwidth = 0.1\n")
    result = run(*scored, *arguments)
    assert result.exit_code == 2
    assert sentence in " ".join(result.stderr.split())


def test_a_text_that_is_no_list_is_reported_with_the_form_of_a_list(tmp_path):
    result = run("workspace", str(tmp_path), "--workspace", "nope.png")
    assert result.exit_code == 2
    expected = "--workspace is ['nope.png']; it must be a list, of each a number in m"
    assert expected in " ".join(result.stderr.split())


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_config_prints_a_file_that_changes_nothing(stage, tmp_path):
    printed = run("config", stage).stdout
    (tmp_path / "settings.toml").write_text(printed, encoding="utf-8")
    assert settings_chosen(stage, tmp_path / "settings.toml", (), ()) == default_settings(stage)
    assert run("config", stage, "--config", tmp_path / "settings.toml").stdout == printed
    for each in settings_of(default_settings(stage)):
        assert f"\n{each.name.rpartition('.')[2]} = " in printed
        assert each.declaration.origin in printed


def test_config_prints_chosen_values_with_their_defaults():
    printed = run("config", "infer", "--set", "selection.ranking.by=eq8").stdout
    assert 'by = "eq8"' in printed
    assert 'Default "critic".' in printed


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_config_prints_the_settings_that_the_environment_gives_to_the_command(stage):
    options = get_command(app).commands[stage].params
    given = {
        each.envvar: "franka"
        for each in options
        if each.envvar is not None and each.rich_help_panel == PANEL
    }
    found = CliRunner(env=given).invoke(app, ["config", stage, "--json"])
    rows = json.loads(found.stdout)["settings"]
    assert {row["variable"]: row["value"] for row in rows if row["variable"] is not None} == given


def test_config_names_the_variable_that_gives_a_value_unless_set_overrides_it():
    runner = CliRunner(env={"SYMGRASP_GRIPPER": "franka"})
    printed = runner.invoke(app, ["config", "infer"]).stdout
    assert 'gripper = "franka"' in printed
    assert 'Default "rg2". Set by SYMGRASP_GRIPPER.' in " ".join(printed.split()).replace(
        " # ", " "
    )
    printed = runner.invoke(app, ["config", "infer", "--set", "gripper=robotiq_2f85"]).stdout
    assert 'gripper = "robotiq_2f85"' in printed
    assert "SYMGRASP_GRIPPER" not in printed
    empty = CliRunner(env={"SYMGRASP_GRIPPER": ""}).invoke(app, ["config", "infer"])
    assert empty.stdout == run("config", "infer").stdout


def test_config_prints_json():
    found = json.loads(run("config", "infer", "--json").stdout)
    rows = {row["name"]: row for row in found["settings"]}
    assert rows["sensor.depth_noise"]["unit"] == "m"
    assert rows["sensor.depth_noise"]["origin"] == "D. 6"
    assert rows["selection.ranking.by"]["choices"] == ["critic", "eq8"]
    assert rows["watch.timeout"]["value"] == "inf"


def test_config_of_an_unknown_stage_is_wrong_usage():
    result = run("config", "infre")
    assert result.exit_code == 2
    assert "the nearest is 'infer'" in result.stderr


def test_the_old_name_of_an_option_still_works(scored, tmp_path):
    assert run(*scored, "--max-width", "0.08").exit_code == 0
    assert read_stamp(tmp_path / "s.npz")["config"]["clip_width"] == 0.08
    assert "--max-width" not in run("score-grasps", "--help").stdout


def test_options_go_before_variables_before_the_file_before_defaults(tmp_path):
    file = tmp_path / "settings.toml"
    file.write_text('gripper = "franka"\nregions = "geometric"\nmax_grasps_per_region = 3\n')
    variable = given("--gripper", "gripper", "robotiq_2f85", by_variable=True)
    config = settings_chosen("infer", file, [variable], ["max_grasps_per_region=4"])
    assert (config.gripper, config.regions) == ("robotiq_2f85", "geometric")
    assert config.max_grasps_per_region == 4
    option = given("--gripper", "gripper", "rg2")
    assert settings_chosen("infer", file, [option], []).gripper == "rg2"
    assert settings_chosen("infer", file, [variable], ["gripper=rg2"]).gripper == "rg2"
    assert settings_chosen("infer", file, [], []).gripper == "franka"
    assert settings_chosen("infer", None, [], []).gripper == "rg2"


@pytest.mark.parametrize(
    ("option", "name"), [("--objects-per-scene=2-3", "min_objects"), ("--size=64x48", "height")]
)
def test_a_setting_of_an_option_for_two_settings_is_not_given_by_set_too(tmp_path, option, name):
    result = run("synthesize", tmp_path / "new", option, "--set", f"{name}=5")
    assert result.exit_code == 2
    shown = option.partition("=")[0]
    assert f"--set {name} is given with {shown}; it must be given once" in result.stderr


BOX = "-1,-1,0,1,1,2"


def test_a_box_of_the_workspace_is_not_given_by_set_too(tmp_path):
    given = ["infer", tmp_path, "--workspace", BOX, "--set", "limits.box=5,5,5,6,6,6"]
    result = run(*given)
    assert result.exit_code == 2
    assert "--set limits.box is given with --workspace; it must be given once" in result.stderr


def test_a_box_of_the_settings_goes_with_a_mask_of_the_workspace(tmp_path):
    frames, mask = tmp_path / "frames", tmp_path / "mask.png"
    frames.mkdir()
    write_image(mask, np.ones((4, 5), np.uint8))
    result = run("infer", frames, "--workspace", mask, "--set", f"limits.box={BOX}")
    assert "holds no RGB-D frames" in result.stderr  # the next fault: the settings are accepted


def test_a_variable_with_an_impossible_value_is_named(tmp_path):
    result = CliRunner(env={"SYMGRASP_GRIPPER": "nohand"}).invoke(
        app, ["infer", "pipelines/weights/frames", "--out", str(tmp_path / "g.h5")]
    )
    assert result.exit_code == 2
    assert "nohand" in result.stderr
