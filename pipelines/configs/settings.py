"""Configs from what a file says of them."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

Config = TypeVar("Config")


def from_settings(kind: type[Config], settings: Mapping[str, Any]) -> Config:
    """Return the config that a stamp holds as JSON, without the names that `kind` lacks."""
    types, chosen = get_type_hints(kind), {}
    for each in fields(kind):  # type: ignore[arg-type]  # a dataclass
        if each.name not in settings:
            continue
        value, inner = settings[each.name], types[each.name]
        if is_dataclass(inner) and isinstance(inner, type):
            value = from_settings(inner, value)
        chosen[each.name] = tuple(value) if isinstance(value, list) else value
    return kind(**chosen)
