"""Settings of a config by dotted name: list, change, and read from the tables of a file."""

import difflib
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar, get_type_hints

from pipelines.configs.declaration import DECLARATION, Declaration
from pipelines.configs.renamed import REMOVED, RENAMED, RENAMED_VALUES
from pipelines.configs.values import choices_of, expectation, fitted, read_text_value
from pipelines.errors import SettingError, UnknownNameError

log = logging.getLogger(__name__)

Config = TypeVar("Config")
MAX_DEPTH = 8  # nested tables; configs have four
UNDECLARED = Declaration("", "", "", float("-inf"), float("inf"))


@dataclass(frozen=True)
class Setting:
    """One setting of a config."""

    name: str  # dotted, as `selection.ranking.by`
    value: Any  # in the config
    default: Any  # value without changes
    declared: Any  # its type
    declaration: Declaration  # unit, meaning, origin and range

    @property
    def choices(self) -> tuple[str, ...]:
        """Allowed names; empty if the setting is not a choice of names."""
        return choices_of(self.declared)

    @property
    def expected(self) -> str:
        """Accepted values, in words."""
        return expectation(self.declared, self.declaration)


def settings_of(config: Any) -> tuple[Setting, ...]:  # noqa: ANN401 - any config
    """Return all settings of `config`, then those of its nested tables."""
    return tuple(_listed(config, type(config)(), ""))


def from_settings(kind: type[Config], settings: Mapping[str, Any], where: str = "") -> Config:
    """Return the config given by the tables of a file; missing settings have their defaults.

    Raises:
        UnknownNameError, SettingError: see `changed`.
    """
    return changed(kind(), settings, where)


def changed(
    config: Config, settings: Mapping[str, Any], where: str = "", option: str | None = None
) -> Config:
    """Return `config` with changed values, given as tables or by dotted names.

    Names of earlier versions are accepted.

    Args:
        config: the config to change.
        settings: the values.
        where: start of error messages: the file that contains the values.
        option: name of the setting in error messages; by default its dotted name.

    Raises:
        UnknownNameError: the setting or the choice is unknown.
        SettingError: a value has the wrong type or is outside of the setting's range.
    """
    for name, value in _flat(settings):
        if name in _before(REMOVED, config):
            why = _before(REMOVED, config)[name]
            log.warning("%ssetting %s is left out: %s", where, name, why)
            continue
        current = current_name(config, name)
        replaced = _before(RENAMED_VALUES, config).get(current, {})
        wanted = replaced.get(value, value) if isinstance(value, str) else value
        change = _Change(config, current, where, option or f"{where}{current}")
        config = change.made(config, current.split("."), wanted)
    return config


def changed_by_text(
    config: Config, name: str, text: str, where: str = "", option: str | None = None
) -> Config:
    """Return `config` with the setting `name` as a command line writes it; see `changed`."""
    current = current_name(config, name)
    declared = {each.name: each.declared for each in settings_of(config)}
    value = read_text_value(text, declared[current]) if current in declared else text
    return changed(config, {name: value}, where, option)


def current_name(config: Any, name: str) -> str:  # noqa: ANN401 - any config
    """Return the name in `config` of a setting; `name` may be that of an earlier version."""
    return str(_before(RENAMED, config).get(name, name))


def check_settings(config: Any) -> None:  # noqa: ANN401 - any config
    """Raise UnknownNameError or SettingError if a value does not fit its declaration."""
    for each in settings_of(config):
        fitted(each.value, each.declared, each.name, each.declaration)


def types_of(kind: Any) -> dict[str, Any]:  # noqa: ANN401 - a dataclass
    """Return the types of a dataclass's fields by name."""
    hints = get_type_hints(kind)
    return {each.name: hints[each.name] for each in fields(kind)}


def _listed(config: Any, default: Any, prefix: str) -> Iterator[Setting]:  # noqa: ANN401 - configs
    tables, types = [], types_of(type(config))
    for field in fields(config):
        value, usual = getattr(config, field.name), getattr(default, field.name)
        if is_dataclass(value):
            tables.append(_listed(value, usual, f"{prefix}{field.name}."))
            continue
        declaration = field.metadata.get(DECLARATION, UNDECLARED)
        yield Setting(prefix + field.name, value, usual, types[field.name], declaration)
    for table in tables:
        yield from table


def _flat(settings: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and value of each setting in `settings`, in order."""
    todo = [(str(name), value, 1) for name, value in reversed(list(settings.items()))]
    while todo:
        name, value, depth = todo.pop()
        if not isinstance(value, Mapping) or not value:
            yield name, value
            continue
        if depth >= MAX_DEPTH:
            shown = f"{name[:40]}..."
            raise SettingError(shown, "nested too deep", f"at most {MAX_DEPTH} tables deep")
        todo += [
            (f"{name}.{key}", inner, depth + 1) for key, inner in reversed(list(value.items()))
        ]


def _before(table: Mapping[str, Mapping[str, Any]], config: object) -> Mapping[str, Any]:
    """Return the entry of `table` for the class of `config`, or for its base class."""
    kinds = [kind.__name__ for kind in type(config).__mro__]
    return next((table[kind] for kind in kinds if kind in table), {})


@dataclass(frozen=True)
class _Change:
    """Change of the setting `name` of `root`; error messages call it `shown`, after `where`."""

    root: Any
    name: str
    where: str
    shown: str

    def made(self, table: Any, path: list[str], value: object) -> Any:  # noqa: ANN401 - configs
        head, *rest = path
        types, inner = types_of(type(table)), getattr(table, head, None)
        if head not in types or (rest and not is_dataclass(inner)):
            raise self._unknown(table)
        if rest:
            return replace(table, **{head: self.made(inner, rest, value)})
        if is_dataclass(inner):
            if value == {}:
                return table
            names = ", ".join(f"{self.name}.{name}" for name in types_of(type(inner)))
            raise SettingError(self.shown, value, f"a table; its settings are {names}")
        field = next(each for each in fields(table) if each.name == head)
        declaration = field.metadata.get(DECLARATION, UNDECLARED)
        return replace(table, **{head: fitted(value, types[head], self.shown, declaration)})

    def _unknown(self, table: Any) -> UnknownNameError:  # noqa: ANN401 - a config
        """Return the error for a setting that `table` lacks, with the nearest name in `root`."""
        everywhere = [each.name for each in settings_of(self.root)]
        last = self.name.rsplit(".", maxsplit=1)[-1]
        nearest = [name for name in everywhere if name.rsplit(".", maxsplit=1)[-1] == last]
        nearest = nearest or difflib.get_close_matches(self.name, everywhere, 1)
        nearest = nearest or difflib.get_close_matches(last, everywhere, 1)
        return UnknownNameError(
            f"{self.where}setting", self.name, types_of(type(table)), *nearest[:1]
        )
