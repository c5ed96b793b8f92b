"""Presets: settings of several commands under one name, `--preset paper`."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from pipelines.errors import UnknownNameError

PRESETS = ("paper",)


def preset_settings(preset: str, stage: str) -> dict[str, Any]:
    """Return the settings of a stage that a preset changes, as tables.

    Raises:
        UnknownNameError: the preset is unknown, or does not change this stage.
    """
    if preset not in PRESETS:
        raise UnknownNameError("preset", preset, PRESETS)
    tables = _tables(preset)
    if stage not in tables:
        raise UnknownNameError(f"stage of the preset {preset}", stage, tables)
    return tables[stage]


def presets_of(stage: str) -> tuple[str, ...]:
    """Return the presets that change settings of `stage`."""
    return tuple(preset for preset in PRESETS if stage in _tables(preset))


@cache
def _tables(preset: str) -> dict[str, dict[str, Any]]:
    """Return the settings of each stage that `preset` changes."""
    text = files(__package__).joinpath(f"{preset}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
