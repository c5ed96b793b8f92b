"""Presets: names and values that exist, and their place among files and options."""

import pytest

from pipelines.configs.presets import PRESETS, preset_settings, presets_of
from pipelines.configs.settings import changed, settings_of
from pipelines.configs.stages import STAGE_SETTINGS, default_settings
from pipelines.errors import UnknownNameError
from symgrasp_cli.settings import settings_chosen


def flat(tables, prefix=""):
    for name, value in tables.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_each_line_of_a_preset_changes_a_setting(preset, stage):
    if preset not in presets_of(stage):
        with pytest.raises(UnknownNameError, match=f"stage of the preset {preset} '{stage}'"):
            preset_settings(preset, stage)
        return
    config = changed(default_settings(stage), preset_settings(preset, stage))
    values = {each.name: each for each in settings_of(config)}
    for name, value in flat(preset_settings(preset, stage)):
        same = {"train.batch_size", "train.weight_feature"}  # stated, though equal to the default
        is_same = values[name].value == values[name].default
        assert not is_same or f"{stage}.{name}" in same, f"{name} = {value} is the default"


def test_the_paper_augments_by_principal_scaling_alone():
    config = changed(default_settings("train"), preset_settings("paper", "train"))
    changes = {name for name, value in vars(config.augmentation).items() if value != 0.0}
    assert changes == {"principal_scale"}


def test_a_file_and_an_option_go_before_the_preset(tmp_path):
    file = tmp_path / "settings.toml"
    file.write_text("clip_detections = true\n", encoding="utf-8")
    config = settings_chosen("infer", file, [], ["selection.ranking.by=critic"], "paper")
    assert config.clip_detections
    assert config.selection.ranking.by == "critic"
    assert config.regions == "detector"
    assert settings_chosen("infer", None, [], [], "paper").selection.ranking.by == "eq8"


def test_an_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="preset 'papre' is not known, the nearest is 'pap"):
        settings_chosen("infer", None, [], [], "papre")
