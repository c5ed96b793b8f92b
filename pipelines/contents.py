"""Checks of file contents: types, forms and bounds; each fault is one sentence."""

import codecs
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from pipelines.errors import FormatError, SymgraspError

# Errors of Python and numpy on content of another type, size or shape than a reader expects.
UNFIT = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RecursionError,
    TypeError,
    ValueError,
)
LONGEST_REASON = 200  # characters of a library's message in a sentence
MAX_PIXELS = 2**24  # of an image: 4096 x 4096; depth cameras have up to six million
MAX_JSON_BYTES = 2**27
MAX_JSON_VALUES = 10_000_000  # a value of any type takes some 70 bytes
MAX_JSON_DEPTH = 100  # levels of nested lists and objects; our files have six


@contextmanager
def reading(path: Path | str, subject: str, expected: str) -> Iterator[None]:
    """Turn errors on content of another type or shape into a FormatError.

        with reading(path, "a region", "name, triangles, symmetries"): ...

    Raises:
        FormatError: "PATH: SUBJECT is not right (REASON); EXPECTED".
    """
    try:
        yield
    except FormatError:
        raise
    except (*UNFIT, SymgraspError) as error:
        raise FormatError(path, f"{subject} is not right ({reason(error)})", expected) from error


def reason(error: BaseException) -> str:
    """Return the message of a Python or library error as part of a sentence."""
    text = " ".join(str(error).split())
    text = f"lacks {text}" if isinstance(error, KeyError) else text or type(error).__name__
    return text if len(text) <= LONGEST_REASON else f"{text[:LONGEST_REASON]}..."


class RepeatedNameError(ValueError):
    """A JSON object with two values of one name, of which the first would be lost."""


def json_value(
    path: Path | str, data: bytes, subject: str = "this", *, by_hand: bool = False
) -> Any:  # noqa: ANN401 - JSON
    """Return the value of JSON in UTF-8; its size, number of values and depth are bounded.

    Raises:
        FormatError: not JSON, or beyond the bounds.
    """
    expected = "a JSON text in UTF-8 is expected"
    values = sum(data.count(mark) for mark in (b",", b"[", b"{", b"{"))  # an object counts twice
    for name, found, most in (
        ("bytes", len(data), MAX_JSON_BYTES),
        ("values", values, MAX_JSON_VALUES),
    ):
        if found > most:
            raise FormatError(path, f"{subject} has {found} {name}", f"at most {most} are read")
    try:
        content = parsed_json(data, by_hand=by_hand)
        deep = is_deep(content, MAX_JSON_DEPTH)
    except RepeatedNameError as error:
        twice = f"{subject} names {error} twice in one object"
        raise FormatError(path, twice, "only the last would count, so name each once") from error
    except (ValueError, RecursionError) as error:  # not text, not JSON, too many digits, too deep
        raise FormatError(path, f"{subject} is not JSON ({reason(error)})", expected) from error
    if deep:
        raise FormatError(path, f"{subject} is nested too deep", f"at most {MAX_JSON_DEPTH} levels")
    return content


def parsed_json(data: bytes, *, by_hand: bool = False) -> Any:  # noqa: ANN401 - JSON
    """Return the value of JSON in the encoding that `encoding_of` tells.

    `by_hand`: names must not be repeated in an object.

    Raises:
        RepeatedNameError: a name is repeated.
        ValueError: not JSON, or text with an unpaired surrogate, which no output can hold.
        RecursionError: nested too deep.
    """
    hook = _with_distinct_names if by_hand else None
    text = data.decode(encoding_of(data))
    content = json.loads(text, object_pairs_hook=hook)
    if "\\ud" in text.lower():
        json.dumps(content, ensure_ascii=False).encode()
    return content


def encoding_of(text: bytes) -> str:
    """Return the encoding of a text, by the byte order mark that programs on Windows write."""
    return "utf-16" if text.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"


def _with_distinct_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for name, value in pairs:
        if name in content:
            raise RepeatedNameError(repr(name))
        content[name] = value
    return content


def json_object(path: Path | str, stored: object, subject: str) -> dict[str, Any]:
    """Return the JSON object in the text `stored`, such as an attribute of a file.

    Raises:
        FormatError: `stored` is no text, or the text is no JSON object.
    """
    text = stored.encode(errors="replace") if isinstance(stored, str) else stored
    content = json_value(path, text, subject) if isinstance(text, bytes) else None
    if not isinstance(content, dict):
        raise FormatError(path, f"{subject} is no JSON object", "write the file again")
    return content


def mapping_in(content: object, name: str) -> Mapping[str, Any]:
    """Return the mapping at the key `name` of the mapping `content`; empty if there is none."""
    found = content.get(name) if isinstance(content, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def typed(kind: Any, value: Any) -> Any:  # noqa: ANN401 - a type, and JSON
    """Return JSON as the type `kind`: an object as a dataclass, a whole number as a float.

    `kind`: bool, int, float, str, Any, a list, dict or tuple of these, a dataclass; or one of them
    | None.

    Raises:
        TypeError, ValueError: the value has another type, or lacks a field of the dataclass.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any or (value is None and NoneType in inner):
        return value
    match value:
        case list() if origin in (list, tuple):
            kinds = inner if origin is tuple else inner * len(value)
            return origin(typed(*pair) for pair in zip(kinds, value, strict=True))
        case dict() if origin is dict:
            return {key: typed(inner[1], each) for key, each in value.items()}
        case dict() if is_dataclass(kind):
            return _typed_fields(kind, value)
    if origin is UnionType:
        return typed(inner[0], value)
    if type(value) is not (int if kind is float and type(value) is int else kind):
        raise TypeError(f"{json.dumps(value)[:40]} is of the wrong type")
    return kind(value)


def _typed_fields(kind: Any, content: dict[str, Any]) -> Any:  # noqa: ANN401 - a dataclass
    hints = get_type_hints(kind)
    unknown = sorted(set(content) - set(hints))
    if unknown:
        raise ValueError(f"`{unknown[0]}` is not known")
    return kind(**{name: typed(hints[name], each) for name, each in content.items()})


def is_deep(content: object, most: int) -> bool:
    """Return whether lists and mappings are nested more than `most` levels deep."""
    level: list[Any] = [content]
    for _ in range(most + 1):
        groups = [each for each in level if isinstance(each, list | Mapping)]
        if not groups:
            return False
        level = [
            each
            for group in groups
            for each in (group.values() if isinstance(group, Mapping) else group)
        ]
    return True
