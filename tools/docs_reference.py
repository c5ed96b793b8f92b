"""Reference pages made from code, as Markdown: commands, settings, Python API."""

import importlib
import inspect
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cached_property
from typing import Any

from typer.main import get_command

from pipelines.configs.settings import settings_of
from pipelines.configs.stages import STAGE_SETTINGS, default_settings
from pipelines.configs.toml_files import toml_value
from symgrasp_cli.app import COMMANDS, app

NAMES = [function.__name__.replace("_", "-") for function in COMMANDS]


def commands() -> str:
    """Return all commands with their options, in workflow order."""
    lines: list[str] = []
    group: Any = get_command(app)
    for name in NAMES:
        command = group.commands[name]
        arguments = [each for each in command.params if not each.opts[0].startswith("-")]
        usage = [f"{each.name.upper()}{' ...' * (each.nargs == -1)}" for each in arguments]
        lines += [f"## {name}", "", inspect.cleandoc(command.help), ""]
        lines += ["```", " ".join(["symgrasp", name, *usage, "[OPTIONS]"]), "```", ""]
        lines += ["| option | default | meaning |", "|---|---|---|"]
        shown = (each for each in command.params if not getattr(each, "hidden", False))
        lines += [_option(each) for each in shown if each.name != "help"]
        lines.append("")
    return "\n".join(lines)


def _option(parameter: Any) -> str:  # noqa: ANN401 - typer's own
    names = [*parameter.opts, *parameter.secondary_opts]
    if not names[0].startswith("-"):
        names = [parameter.name.upper()]
    default = "required" if parameter.required else _shown(parameter.default)
    return f"| {', '.join(f'`{name}`' for name in names)} | {default} | {_cell(parameter.help)} |"


def settings() -> str:
    """Return all settings of all stages, in workflow order."""
    lines: list[str] = []
    for name in STAGE_SETTINGS:
        config = default_settings(name)
        lines += [f"## {name}", "", inspect.cleandoc(config.__doc__), ""]
        lines += ["| setting | default | accepts | meaning | origin |", "|---|---|---|---|---|"]
        for each in settings_of(config):
            words = [each.expected, each.declaration.meaning, each.declaration.origin]
            default = toml_value(each.default).strip('"')
            lines.append(f"| `{each.name}` | {_shown(default)} | {' | '.join(map(_cell, words))} |")
        lines.append("")
    return "\n".join(lines)


def api() -> str:
    """Return the public Python names of `symgrasp`, with signatures and docstrings."""
    package = importlib.import_module("symgrasp")
    lines: list[str] = []
    for name in sorted(package.__all__, key=lambda name: _rank(getattr(package, name))):
        value = getattr(package, name)
        if not callable(value):
            continue
        is_class = inspect.isclass(value)
        lines += [f"## {name}", ""]
        if not is_class or _is_made_by_users(value):
            lines += [_code(name + _signature(value))]
        lines += [_docstring(value), ""]
        if is_class and _is_made_by_users(value):
            lines += [_docstring(value.__init__), ""]
        for member, function in _public(value) if is_class else ():
            lines += [f"### {name}.{member}", ""]
            if inspect.isfunction(vars(value)[member]):  # a property has no arguments
                lines += [_code(member + _signature(function))]
            lines += [_docstring(function), ""]
    return "\n".join(lines)


def _rank(value: Any) -> int:  # noqa: ANN401
    """Return the rank of a name: callables for users first, then results, then errors."""
    if not inspect.isclass(value):
        return 1
    return 0 if _is_made_by_users(value) else 2 if is_dataclass(value) else 3


def _is_made_by_users(kind: type) -> bool:
    """Return whether users construct the class; results and errors are constructed for them."""
    return "__init__" in vars(kind) and not is_dataclass(kind)


def _public(kind: type) -> Iterator[tuple[str, Any]]:
    """Yield name and function of the methods and properties of `kind` that users call."""
    for name, member in vars(kind).items():
        function = member.fget if isinstance(member, property) else member
        function = member.func if isinstance(member, cached_property) else function
        function = getattr(function, "__func__", function)  # function of a class method
        if inspect.isfunction(function) and (name == "__call__" or not name.startswith("_")):
            yield name, function


def _code(text: str) -> str:
    return f"```python\n{text}\n```\n"


def _signature(value: Any) -> str:  # noqa: ANN401
    """Return names and defaults of the arguments; their types are in the docstring."""
    signature = inspect.signature(value)
    shown = [
        each.replace(annotation=inspect.Parameter.empty)
        for each in signature.parameters.values()
        if each.name != "self"
    ]
    empty = inspect.Signature.empty
    return str(signature.replace(parameters=shown, return_annotation=empty))


def _docstring(value: Any) -> str:  # noqa: ANN401
    """Return a docstring in Google's style as Markdown: sections in bold, entries as lists."""
    lines, inside = [], False
    for line in (inspect.getdoc(value) or "").splitlines():
        if head := re.fullmatch(r"(Args|Attributes|Raises|Returns|Yields):", line):
            lines, inside = [*lines, f"**{head[1]}**", ""], True
        elif inside and (entry := re.fullmatch(r"    (\*{0,2}\w+): (.*)", line)):
            lines.append(f"* `{entry[1]}`: {entry[2]}")
        else:
            inside = inside and (not line or line.startswith("    "))
            lines.append(line[4:] if inside else line)
    return "\n".join(lines)


def _shown(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, bool):
        return "on" if value else "off"
    text = _cell(f"{value:.6g}" if isinstance(value, float) else str(value))
    return f"`{text}`" if text and value is not None else ""


def _cell(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|").replace("<", "&lt;")
