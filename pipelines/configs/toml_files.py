"""Settings files: TOML, read within size limits, written with unit, meaning and origin."""

import json
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pipelines.configs.settings import Setting, settings_of
from pipelines.contents import encoding_of, is_deep, reason
from pipelines.errors import FormatError, MissingInputError

MAX_BYTES = 2**20
MAX_LEVELS = 20  # nested tables and lists; configs have four
WIDTH = 100  # characters of a comment line
AS_TOML = "settings as `symgrasp config STAGE` prints them are expected"


def read_toml(path: Path, expected: str = AS_TOML) -> dict[str, Any]:
    """Return the tables of a TOML file; error messages end with `expected`.

    Raises:
        MissingInputError: the file does not exist.
        FormatError: the file is too large, nested too deep, or not TOML.
    """
    if not path.is_file():
        raise MissingInputError(path, "symgrasp config STAGE")
    with path.open("rb") as stream:
        content = stream.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise FormatError(path, f"is larger than {MAX_BYTES} bytes", expected)
    try:
        tables = tomllib.loads(content.decode(encoding_of(content)))
        deep = is_deep(tables, MAX_LEVELS)
    except RecursionError:
        deep = True
    except ValueError as error:  # not TOML, not text, or a number of thousands of digits
        raise FormatError(path, f"is not TOML ({reason(error)})", expected) from error
    if deep:
        raise FormatError(path, "is nested too deep", expected)
    return tables


def as_toml(
    config: Any,  # noqa: ANN401 - any config
    title: str,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return settings as TOML with a comment for each: meaning, unit, accepted values, origin.

    Args:
        config: the settings.
        title: first comment.
        variables: names of settings -> environment variables that gave their values.
    """
    return "\n".join([*_comment(title), *_table(config, "", variables)]) + "\n"


def _table(config: Any, name: str, variables: Mapping[str, str]) -> Iterator[str]:  # noqa: ANN401
    yield ""
    yield from _comment((type(config).__doc__ or "").strip().partition("\n")[0])
    if name:
        yield f"[{name}]"
    for each in settings_of(config):
        if "." not in each.name:
            variable = variables.get(f"{name}.{each.name}" if name else each.name)
            yield ""
            yield from _comment(described(each) + (f" Set by {variable}." if variable else ""))
            yield f"{each.name} = {toml_value(each.value)}"
    for field in fields(config):
        inner = getattr(config, field.name)
        if is_dataclass(inner):
            yield from _table(inner, f"{name}.{field.name}" if name else field.name, variables)


def described(each: Setting) -> str:
    """Return meaning, unit, accepted values, origin and default of a setting in one line."""
    declaration = each.declaration
    default = "" if each.value == each.default else f" Default {toml_value(each.default)}."
    return f"{declaration.meaning} ({each.expected}; {declaration.origin}){default}"


def toml_value(value: object) -> str:
    """Return a switch, number, text or tuple of these in TOML syntax."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def _comment(text: str) -> list[str]:
    joined = text.replace("D. ", "D.\N{NO-BREAK SPACE}")  # a citation stays on its line
    lines = textwrap.wrap(
        joined, WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]
