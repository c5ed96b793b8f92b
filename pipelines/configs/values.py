"""Values of settings: checks against declared type and range, and reading from text."""

import math
import re
from typing import Any, Literal, get_args, get_origin

from pipelines.configs.declaration import Declaration
from pipelines.errors import SettingError, UnknownNameError

SWITCHES = {"true": True, "false": False}
UNITLESS = ("", "share", "count", "factor", "weight", "direction")
NAMES_OF_TYPES = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def fitted(value: object, declared: Any, name: str, declaration: Declaration) -> Any:  # noqa: ANN401
    """Return `value` in its declared type: lists become tuples, whole numbers floats.

    Numbers and arrays of numpy are those of Python.

    Args:
        value: value from a file, an option or a program.
        declared: bool, int, float, str, a `Literal`, or a tuple of one of these.
        name: name of the setting, for error messages.
        declaration: unit and range.

    Raises:
        UnknownNameError: the `Literal` does not list the name.
        SettingError: the type is wrong, or a number is outside of the range.
    """
    if hasattr(value, "tolist"):  # numpy's
        value = value.tolist()
    if get_origin(declared) is tuple:
        return _fitted_tuple(value, declared, name, declaration)
    if choices := choices_of(declared):
        if not isinstance(value, str) or value not in choices:
            raise UnknownNameError(name, str(value), choices)
        return value
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if declared is float and is_number:
        value = _as_float(value)  # type: ignore[arg-type]  # a number
    if type(value) is not declared:
        raise SettingError(name, _shown(value), expectation(declared, declaration))
    if is_number and not declaration.low <= value <= declaration.high:  # type: ignore[operator]
        raise SettingError(name, value, expectation(declared, declaration))
    return value


def _as_float(number: float) -> float:
    """Return the float nearest to `number`, infinity for integers beyond all floats."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _fitted_tuple(
    value: object,
    declared: Any,  # noqa: ANN401 - a type
    name: str,
    declaration: Declaration,
) -> tuple[Any, ...]:
    kinds = get_args(declared)
    if not isinstance(value, list | tuple) or (
        kinds[-1] is not Ellipsis and len(value) != len(kinds)
    ):
        raise SettingError(name, _shown(value), expectation(declared, declaration))
    if len(value) < declaration.fewest:
        expected = f"{expectation(declared, declaration)}; at least {declaration.fewest}"
        raise SettingError(name, "an empty list", expected)
    try:
        return tuple(fitted(each, kinds[0], name, declaration) for each in value)
    except SettingError:
        raise SettingError(name, value, expectation(declared, declaration)) from None


def read_text_value(text: str, declared: Any) -> object:  # noqa: ANN401 - a type
    """Return the value of `text` from a command line, as input of `fitted`.

    Tuples have commas or spaces, with or without brackets. Text that is no number stays text,
    which `fitted` rejects.
    """
    text = text.strip()
    if get_origin(declared) is tuple:
        inner = text[1:-1] if text[:1] == "[" and text[-1:] == "]" else text
        kind = get_args(declared)[0]
        return [read_text_value(part, kind) for part in re.split(r"[,\s]+", inner.strip()) if part]
    if declared is bool:
        return SWITCHES.get(text, text)
    if declared in (int, float):
        try:
            return declared(text)
        except ValueError:
            return text
    quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return text[1:-1] if quoted else text


def choices_of(declared: Any) -> tuple[str, ...]:  # noqa: ANN401 - a type
    """Return the names that a `Literal`, or a tuple of a `Literal`, lists; else nothing."""
    if get_origin(declared) is tuple:
        return choices_of(get_args(declared)[0])
    return get_args(declared) if get_origin(declared) is Literal else ()


def expectation(declared: Any, declaration: Declaration) -> str:  # noqa: ANN401 - a type
    """Return the accepted values of a setting in words: "a whole number, at least 1"."""
    if get_origin(declared) is tuple:
        kinds = get_args(declared)
        count = "a list" if kinds[-1] is Ellipsis else f"a list of {len(kinds)}"
        return f"{count}, of each {expectation(kinds[0], declaration)}"
    if choices := choices_of(declared):
        return f"one of {', '.join(choices)}"
    words = NAMES_OF_TYPES.get(declared, str(declared))
    if declared not in (int, float):
        return words
    if declaration.unit not in UNITLESS:
        words += f" in {declaration.unit}"
    low, high = declaration.low, declaration.high
    if math.isfinite(low) and math.isfinite(high):
        return f"{words} from {low:g} to {high:g}"
    return f"{words}, at least {low:g}" if math.isfinite(low) else words


def _shown(value: object) -> str:
    return repr(value) if isinstance(value, str) else str(value)
