"""`symgrasp config`."""

import json
import math
from typing import Annotated

import typer

from pipelines.configs.settings import Setting, settings_of
from pipelines.configs.stages import STAGE_SETTINGS
from pipelines.configs.toml_files import as_toml
from symgrasp_cli.options import AsJson
from symgrasp_cli.settings import (
    Assignments,
    Preset,
    SettingsFile,
    given_by_variables,
    settings_chosen,
)

TITLE = (
    "Settings of `symgrasp {stage}`: save them as a file, change values, delete unchanged lines, "
    "and pass the file by --config. Each comment ends with the accepted values and the origin of "
    "the default: the paper, a decision record (D.), or chosen by eye."
)


def config(
    stage: Annotated[
        str,
        typer.Argument(
            help="Command whose settings to print.", autocompletion=lambda: list(STAGE_SETTINGS)
        ),
    ],
    *,
    preset: Preset = None,
    settings_file: SettingsFile = None,
    assignments: Assignments = None,
    as_json: AsJson = False,
) -> None:
    """Print all settings of a command with unit, meaning and origin, as a file for --config."""
    given = given_by_variables(stage)
    chosen = settings_chosen(stage, settings_file, given, assignments or (), preset)
    assigned = {each.partition("=")[0].strip() for each in assignments or ()}
    by_variable = {each.option.setting.name: each.option.variable or "" for each in given}
    variables = {name: each for name, each in by_variable.items() if name not in assigned}
    if as_json:
        rows = [_row(each, variables.get(each.name)) for each in settings_of(chosen)]
        typer.echo(json.dumps({"stage": stage, "settings": rows}, indent=1, ensure_ascii=False))
    else:
        typer.echo(as_toml(chosen, TITLE.format(stage=stage), variables), nl=False)


def _row(each: Setting, variable: str | None) -> dict[str, object]:
    declaration = each.declaration
    return {
        "name": each.name,
        "value": _plain(each.value),
        "default": _plain(each.default),
        "unit": declaration.unit,
        "accepts": each.expected,
        "choices": list(each.choices),
        "meaning": declaration.meaning,
        "origin": declaration.origin,
        "variable": variable,
    }


def _plain(value: object) -> object:
    """Return a value for JSON; infinity, which JSON lacks, becomes text."""
    return "inf" if value == math.inf else value
