"""Settings: declared in full, changed by name, refused by name, kept by TOML."""

import dataclasses
import logging
import math
import re
import tomllib
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from pipelines.configs import (
    EndlessConfig,
    FeasibilityConfig,
    InferConfig,
    LabelGraspsConfig,
    SelectionConfig,
    SymmetryConfig,
    TrainConfig,
    check_settings,
    from_settings,
)
from pipelines.configs.dataset import Sensor
from pipelines.configs.declaration import UNITS
from pipelines.configs.inference import ExportFormat
from pipelines.configs.renamed import REMOVED, RENAMED, RENAMED_VALUES
from pipelines.configs.settings import Setting, changed, changed_by_text, settings_of
from pipelines.configs.stages import STAGE_SETTINGS, default_settings
from pipelines.configs.toml_files import MAX_BYTES, as_toml, read_toml, toml_value
from pipelines.errors import FormatError, SettingError, SymgraspError, UnknownNameError
from pipelines.export import TO_FILE, TO_FOLDER
from pipelines.synthesis.scenes.depth_sensors import SENSORS

ROOT = Path(__file__).resolve().parents[2]


def another(each: Setting) -> object:
    """Return a valid value of the setting other than the default."""
    declaration, value = each.declaration, each.default
    if each.choices:
        others = [name for name in each.choices if value not in {(name,), name}]
        return (others[0],) if isinstance(value, tuple) else others[0]
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return f'hand{value} "\\\x7fü'
    if isinstance(value, tuple):
        usual = value or (0.25,) * 6
        return tuple(type(part)(min(part + 1, declaration.high)) for part in usual)
    if value >= declaration.high:
        return declaration.low + 1 if math.isinf(value) else type(value)(value / 2)
    return type(value)(min(value + 1, declaration.high))


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_every_setting_declares_unit_meaning_and_origin_and_its_default_fits(stage):
    check_settings(default_settings(stage))
    for each in settings_of(default_settings(stage)):
        declaration = each.declaration
        assert declaration.meaning[0].isupper() or declaration.meaning[:2] in ("2 ", "w^"), each
        assert declaration.meaning.endswith("."), each
        assert declaration.origin, each
        assert declaration.unit in UNITS, each
        is_number = each.declared in (int, float) or isinstance(each.default, tuple)
        assert bool(declaration.unit) == (is_number and not each.choices), each


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_settings_of_a_stage_survive_being_written_and_read_as_toml(stage, tmp_path):
    usual = default_settings(stage)
    assert from_settings(type(usual), tomllib.loads(as_toml(usual, "title"))) == usual
    config = usual
    for each in settings_of(usual):
        config = changed(config, {each.name: another(each)})
    pairs = zip(settings_of(config), settings_of(usual), strict=True)
    assert all(new.value != old.value for new, old in pairs)
    path = tmp_path / "settings.toml"
    path.write_text(as_toml(config, "title"), encoding="utf-8")
    assert changed(usual, read_toml(path)) == config


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_every_setting_can_be_set_by_its_name_and_the_text_of_its_value(stage):
    for each in settings_of(default_settings(stage)):
        value = another(each)
        text = value if isinstance(value, str) else toml_value(value)
        config = changed_by_text(default_settings(stage), each.name, text)
        assert {each.name: each.value for each in settings_of(config)}[each.name] == value


@pytest.mark.parametrize(
    ("name", "nearest", "known"),
    [
        ("regoins", "regions", "selection"),
        ("selection.ranking.bye", "selection.ranking.by", "max_ranked"),
        ("max_ranked", "selection.ranking.max_ranked", "limits"),
        ("selecton.ranking.max_ranked", "selection.ranking.max_ranked", "limits"),
        ("regions.x", "regions", "selection"),
    ],
)
def test_a_misspelt_setting_is_refused_with_the_nearest_name_and_all_known_names(
    name, nearest, known
):
    with pytest.raises(UnknownNameError, match=f"the nearest is '{nearest}'.*known are.*{known}"):
        from_settings(InferConfig, {name: 1})


def test_no_name_is_called_the_nearest_of_a_setting_unlike_all_others():
    with pytest.raises(UnknownNameError, match=r"'top' is not known; known are.*max_grasps"):
        from_settings(InferConfig, {"top": 3})


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"max_grasps_per_region": "many"}, "a whole number, at least 1"),
        ({"max_grasps_per_region": 0}, "a whole number, at least 1"),
        ({"max_grasps_per_region": 2.5}, "a whole number, at least 1"),
        ({"max_grasps_per_region": True}, "a whole number, at least 1"),
        ({"mirrored": 1}, "true or false"),
        ({"gripper": 3}, "a text"),
        ({"min_foreground": 1.5}, "a number from 0 to 1"),
        ({"min_foreground": math.nan}, "a number from 0 to 1"),
        ({"min_foreground": 10**400}, "a number from 0 to 1"),
        ({"sensor": {"depth_noise": -(10**400)}}, "a number in m, at least 0"),
        ({"limits": {"approach_direction": [0, 1]}}, "a list of 3"),
        ({"limits": {"box": 3}}, "a list, of each a number in m"),
        (
            {"selection": {"feasibility": {"opening_margins": [0.1, "wide"]}}},
            "a number in m, at least 0",
        ),
        # Sides of cubes into which points are sorted.
        ({"selection": {"candidates": {"pair_spacing": 0.0}}}, "a number in m, at least 0.0001"),
        ({"selection": 3}, "a table; its settings are selection.symmetry"),
        ({"selection": {"a": {"b": {"c": {"d": {"e": {"f": {"g": {"h": 1}}}}}}}}}, "tables deep"),
    ],
)
def test_a_wrong_type_or_a_number_out_of_range_is_refused_with_the_allowed_values(
    settings, expected
):
    with pytest.raises(SettingError, match=expected):
        from_settings(InferConfig, settings)


@pytest.mark.parametrize("name", ["labels.num_points", "min_points", "max_points"])
def test_no_more_label_points_are_made_than_are_read(name):
    with pytest.raises(SettingError, match=r"1000001; .* to 100000"):
        changed_by_text(LabelGraspsConfig(), name, "1000001")


@pytest.mark.parametrize("stage", STAGE_SETTINGS)
def test_an_empty_list_is_refused_unless_it_stands_for_none(stage):
    config = default_settings(stage)
    lists = [each for each in settings_of(config) if get_args(each.declared)[-1:] == (...,)]
    for each in lists:
        if each.name.endswith(("box", "opening_margins")):
            assert changed_by_text(config, each.name, "[]")
        else:
            with pytest.raises(SettingError, match=r"an empty list; .*; at least 1"):
                changed_by_text(config, each.name, "[]")


def test_an_unknown_choice_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="the nearest is 'geometric'; known are auto, det"):
        from_settings(InferConfig, {"regions": "geometri"})


def test_an_unknown_table_is_refused_even_if_it_is_empty():
    with pytest.raises(UnknownNameError, match="'selektion'"):
        from_settings(InferConfig, {"selektion": {}})
    assert from_settings(InferConfig, {"selection": {}}) == InferConfig()


def test_whole_numbers_are_numbers_and_lists_are_tuples():
    config = from_settings(InferConfig, {"limits": {"box": [0, 0, 0, 1, 1, 1], "approach_cone": 9}})
    assert config.limits.box == (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    assert {type(each) for each in (*config.limits.box, config.limits.approach_cone)} == {float}


def test_numbers_and_arrays_of_numpy_are_those_of_python():
    values = {
        "max_grasps_per_region": np.int64(3),
        "limits.approach_cone": np.float32(9),
        "limits.box": np.array([0, 0, 0, 1, 1, 1]),
        "region.color.is_used": np.bool_(False),
    }
    config = changed(InferConfig(), values)
    assert type(config.max_grasps_per_region) is int
    assert config.limits.approach_cone == 9.0
    assert config.limits.box == (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    assert config.region.color.is_used is False


def test_names_of_earlier_versions_are_read_as_todays_names():
    old = {"selection": {"min_trust": 0.3, "spare_room": [0.01], "rank_by": "judge"}}
    config = from_settings(InferConfig, old)
    selection = SelectionConfig(
        SymmetryConfig(min_confidence=0.3), feasibility=FeasibilityConfig(opening_margins=(0.01,))
    )
    assert config == InferConfig(selection=selection)
    again = changed_by_text(config, "selection.steadiness", "0.5")
    assert again.selection.ranking.min_stability == 0.5
    ungrouped = from_settings(InferConfig, {"selection": {"max_pairs": 9, "depth_noise": 0.001}})
    assert ungrouped.selection.candidates.max_pairs == 9
    assert ungrouped.sensor.depth_noise == 0.001
    for where in ("selection.symmetry", "selection"):
        spelled = changed_by_text(config, f"{where}.min_neighbour_confidence", "0.6")
        assert spelled.selection.symmetry.min_neighbor_confidence == 0.6


def test_the_scenery_of_endless_regions_is_read_as_their_surroundings(caplog):
    scenery = {"surroundings": ["bin"], "robot_hands": 0.5, "colors": "varied", "depth_faults": 0.1}
    old = from_settings(TrainConfig, {"endless": {"scenery": scenery}})
    assert old == TrainConfig(endless=EndlessConfig(surroundings=("bin",)))
    assert "endless.scenery.depth_faults is left out: it had no effect" in caplog.text


def test_removed_settings_are_ignored_with_a_warning(monkeypatch, caplog):
    monkeypatch.setitem(REMOVED, "InferConfig", {"selection.luck": "it brought nothing"})
    with caplog.at_level(logging.WARNING):
        assert from_settings(InferConfig, {"selection": {"luck": 1}}) == InferConfig()
    assert "selection.luck is left out: it brought nothing" in caplog.text


def test_renamed_settings_exist_under_their_new_names():
    kinds = {kind.__name__: kind for stage in STAGE_SETTINGS.values() for kind in stage.__mro__}
    kinds |= {
        type(getattr(default_settings(stage), field.name)).__name__: type(
            getattr(default_settings(stage), field.name)
        )
        for stage in STAGE_SETTINGS
        for field in dataclasses.fields(STAGE_SETTINGS[stage])
    }
    for table in (RENAMED, RENAMED_VALUES):
        for kind, names in table.items():
            known = {each.name for each in settings_of(kinds[kind]())}
            assert set(names.values() if table is RENAMED else names) <= known, kind


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("a = " + "[" * 5000 + "]" * 5000, "nested too deep"),
        ("a = " + "{b = " * 3000 + "1" + "}" * 3000, "nested too deep"),
        ("a = [", "is not TOML"),
        ("# " + "x" * MAX_BYTES, "is larger than"),
        (b"a = '\xff'", "is not TOML"),
        ("min_score = " + "9" * 5000, "is not TOML"),
    ],
)
def test_a_wrong_settings_file_is_reported_in_one_sentence(tmp_path, content, fault):
    path = tmp_path / "settings.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FormatError, match=fault):
        read_toml(path)


def test_dotted_keys_without_end_are_reported_in_one_sentence(tmp_path):
    path = tmp_path / "settings.toml"
    path.write_text(".".join("a" * 5000) + " = 1\n")
    with pytest.raises(SymgraspError, match="nested too deep"):
        from_settings(InferConfig, read_toml(path))


def test_the_example_in_the_guide_is_a_valid_settings_file():
    guide = (ROOT / "docs" / "how-to" / "settings.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```toml\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)
    config = from_settings(InferConfig, tomllib.loads(example))
    assert config.gripper == "franka"
    assert config != InferConfig(gripper="franka")


def test_the_choices_are_the_names_that_the_stages_know():
    assert set(get_args(ExportFormat)) == {*TO_FILE, *TO_FOLDER}
    assert set(get_args(Sensor)) == {*SENSORS, "perfect", "mixed"}
