"""Options of commands that change settings, made from the declarations of the settings."""

import inspect
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from pipelines.configs.presets import preset_settings, presets_of
from pipelines.configs.settings import (
    Setting,
    changed,
    changed_by_text,
    current_name,
    settings_of,
)
from pipelines.configs.stages import default_settings
from pipelines.configs.toml_files import read_toml
from pipelines.errors import SettingError
from symgrasp_cli.arguments import arguments_of, options_of
from symgrasp_cli.options import AsJson, Quiet
from symgrasp_cli.report import ReportStyle, reporting_in

Command = Callable[..., None]
Config = TypeVar("Config")
SettingsOf = Sequence[str] | Callable[[str], Sequence[str]]
PANEL, SWITCHES = "Settings", "Settings, on or off"  # the two names of a switch are wide
VARIABLES = {  # stage -> setting -> environment variable that changes it
    "infer": {"gripper": "SYMGRASP_GRIPPER"},
    "serve": {"gripper": "SYMGRASP_GRIPPER"},
}
UNIT_NAMES = {"m": "METRES", "deg": "DEGREES", "s": "SECONDS", "share": "SHARE"}
SettingsFile = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        exists=True,
        dir_okay=False,
        rich_help_panel=PANEL,
        help="TOML file of settings, as `symgrasp config` prints it. SYMGRASP_ variables override "
        "the file; options and --set override both.",
    ),
]
Preset = Annotated[
    str | None,
    typer.Option(
        "--preset",
        metavar="NAME",
        rich_help_panel=PANEL,
        help="Settings under one name; paper: the method as printed. Variables, --config and "
        "options override it.",
    ),
]
Assignments = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        rich_help_panel=PANEL,
        help="Any setting that `symgrasp config` lists; may be given again.",
    ),
]


@dataclass(frozen=True)
class SettingOption:
    """One option of a command, which changes one setting.

    Attributes:
        names: names in typer's form: `--cut/--no-cut`.
        setting: declaration and default of the setting.
        variable: environment variable; None for none.
        hidden: whether the option is an old name that help does not list.
    """

    names: str
    setting: Setting
    variable: str | None = None
    hidden: bool = False

    @property
    def name(self) -> str:
        """The option's first name."""
        return self.names.partition("/")[0]

    @property
    def key(self) -> str:
        """Name of the parameter."""
        return self.name.strip("-").replace("-", "_")

    def parameter(self) -> inspect.Parameter:
        """Return the parameter that typer makes into the option, with the setting's default."""
        choices, is_switch = self.setting.choices, self.setting.declared is bool
        option = typer.Option(
            self.names,
            help=_help(self.setting),
            metavar="" if is_switch else _metavar(self.setting),
            envvar=self.variable,
            hidden=self.hidden,
            rich_help_panel=SWITCHES if "/" in self.names else PANEL,
            autocompletion=(lambda: list(choices)) if choices else None,
        )
        if is_switch:
            return _keyword(self.key, Annotated[bool, option], self.setting.default)
        return _keyword(self.key, Annotated[str | None, option], _text(self.setting.default))


@dataclass(frozen=True)
class GivenOption:
    """The value of a setting, given by an option or by the option's environment variable."""

    option: SettingOption
    value: str | bool
    by_variable: bool

    def applied_to(self, config: Config) -> Config:
        """Return `config` with the value."""
        name = self.option.setting.name
        shown = self.option.variable if self.by_variable else self.option.name
        if isinstance(self.value, bool):
            return changed(config, {name: self.value}, option=shown)
        return changed_by_text(config, name, self.value, option=shown)


def named_as(*settings: str) -> dict[str, str]:
    """Return options that have the last part of the settings' names."""
    return {f"--{name.rpartition('.')[2].replace('_', '-')}": name for name in settings}


def with_settings(
    stage: str,
    options: Mapping[str, str],
    *,
    hidden: Mapping[str, str] | None = None,
    composite: Mapping[str, SettingsOf] | None = None,
) -> Callable[[Command], Command]:
    """Give a command the settings of `stage`, as its argument `config`.

    The command gets `--config` and `--set` too, and `--json` and `--quiet` for its report. An
    argument that is built from several options (`FromOptions`) adds these options.

    Args:
        stage: name in `pipelines.configs.stages`.
        options: names of options -> dotted name of the setting that each changes.
        hidden: the same for old names, which help does not list.
        composite: options by which the command itself changes settings, each with their names, or
            with a function from the option's value to the names.
    """
    known = {each.name: each for each in settings_of(default_settings(stage))}
    variables = VARIABLES.get(stage, {})
    made = [SettingOption(names, known[n], variables.get(n)) for names, n in options.items()]
    made += [SettingOption(names, known[n], hidden=True) for names, n in (hidden or {}).items()]

    def decorate(command: Command) -> Command:
        @wraps(command)
        def run(context: typer.Context, **values: Any) -> None:  # noqa: ANN401 - any option
            file, assignments = values.pop("settings_file"), values.pop("assignments")
            preset = values.pop("preset", None)
            style = ReportStyle(values.pop("as_json"), values.pop("quiet"))
            given = _options_given(context, made, values)
            with reporting_in(style):
                by_command = _by_command(composite or {}, values)
                chosen = settings_chosen(stage, file, given, assignments or (), preset, by_command)
                command(config=chosen, **arguments_of(own, values))

        declared = inspect.signature(command, eval_str=True).parameters.values()
        own = [each for each in declared if each.name != "config"]
        parameters = [
            _keyword("context", typer.Context),
            *(_keyword(p.name, p.annotation, p.default) for p in options_of(own).values()),
            *(each.parameter() for each in made),
            *([_keyword("preset", Preset, None)] if presets_of(stage) else []),
            _keyword("settings_file", SettingsFile, None),
            _keyword("assignments", Assignments, None),
            _keyword("as_json", AsJson, False),
            _keyword("quiet", Quiet, False),
        ]
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {each.name: each.annotation for each in parameters}
        return run

    return decorate


def given_by_variables(stage: str) -> list[GivenOption]:
    """Return the settings that the environment gives to `stage`; empty variables give none."""
    known = {each.name: each for each in settings_of(default_settings(stage))}
    variables = VARIABLES.get(stage, {}).items()
    given = [(known[name], each, os.environ.get(each, "")) for name, each in variables]
    return [
        GivenOption(SettingOption("", setting, variable), value, by_variable=True)
        for setting, variable, value in given
        if value
    ]


def settings_chosen(
    stage: str,
    file: Path | None,
    given: Sequence[GivenOption],
    assignments: Sequence[str],
    preset: str | None = None,
    by_command: Mapping[str, str] | None = None,
) -> Any:  # noqa: ANN401 - a config
    """Return settings by precedence: defaults, preset, file, variables, then options and `--set`.

    `by_command`: names of settings that the command will change -> the option that changes them.

    Raises:
        SymgraspError: a name is unknown, a value is invalid, or one setting is given twice.
    """
    config = default_settings(stage)
    if preset is not None:
        config = changed(config, preset_settings(preset, stage), f"preset {preset}: ")
    if file is not None:
        config = changed(config, read_toml(file), f"{file}: ")
    for each in sorted(given, key=lambda each: not each.by_variable):
        config = each.applied_to(config)
    given_by = dict(by_command or {})
    for each in given:
        if not each.by_variable:
            _note_once(given_by, each.option.setting.name, each.option.name)
    for text in assignments:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise SettingError("--set", repr(text), "NAME=VALUE; `symgrasp config` lists the names")
        current = current_name(config, name)
        _note_once(given_by, current, f"--set {name}")
        config = changed_by_text(config, name, value, "--set: ")
    return config


def _note_once(given_by: dict[str, str], name: str, option: str) -> None:
    """Note that `option` gives the setting `name`, which no other option may give.

    Raises:
        SettingError: another option gives it.
    """
    if name in given_by:
        raise SettingError(option, f"given with {given_by[name]}", "given once")
    given_by[name] = option


def _by_command(composite: Mapping[str, SettingsOf], values: Mapping[str, Any]) -> dict[str, str]:
    """Return the settings that the `composite` options give, each with its option."""
    found: dict[str, str] = {}
    for option, names in composite.items():
        if (value := values[option.strip("-").replace("-", "_")]) is not None:
            found |= dict.fromkeys(names(value) if callable(names) else names, option)
    return found


def _options_given(
    context: typer.Context, options: Sequence[SettingOption], values: dict[str, Any]
) -> list[GivenOption]:
    """Take the values of `options` out of `values`; return those that were given."""
    given = []
    for option in options:
        value, source = values.pop(option.key), context.get_parameter_source(option.key)
        if source is not None and source.name in {"COMMANDLINE", "ENVIRONMENT"}:
            given.append(GivenOption(option, value, source.name == "ENVIRONMENT"))
    return given


def _help(setting: Setting) -> str:
    """Return the meaning, with the choices if the meaning does not name them all."""
    meaning = setting.declaration.meaning
    if all(re.search(rf"\b{name}\b", meaning) for name in setting.choices):
        return meaning
    return f"{meaning} One of {', '.join(setting.choices)}."


def _metavar(setting: Setting) -> str:
    """Return the placeholder that help shows for a value."""
    if isinstance(setting.default, tuple):
        return "X,..."
    if setting.choices or setting.declared is str:
        return "NAME"
    return UNIT_NAMES.get(setting.declaration.unit, "N" if setting.declared is int else "X")


def _text(value: object) -> str | None:
    """Return a value in the form of the command line; None for an empty value."""
    text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return text or None


def _keyword(
    name: str,
    annotation: Any,  # noqa: ANN401 - any type
    default: Any = inspect.Parameter.empty,  # noqa: ANN401
) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)
