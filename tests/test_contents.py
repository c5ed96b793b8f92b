"""Checks that all readers share: allowed content, and one error sentence otherwise."""

import json
from dataclasses import dataclass, field

import pytest

from pipelines import contents
from pipelines.contents import is_deep, json_object, json_value, mapping_in, reading, typed
from pipelines.errors import FormatError, ValueRangeError


@dataclass(frozen=True)
class Inner:
    """A dataclass for a part of the content."""

    share: float
    names: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Outer:
    """A dataclass for the whole content."""

    number: int
    parts: dict[str, Inner]
    note: str | None = None


WHOLE = {"number": 3, "parts": {"a": {"share": 1, "names": ["x"]}}, "note": None}


def test_json_is_read_into_dataclasses_and_whole_numbers_become_floats() -> None:
    found = typed(Outer, WHOLE)
    assert found == Outer(3, {"a": Inner(1.0, ["x"])})
    assert type(found.parts["a"].share) is float


@pytest.mark.parametrize(
    "change",
    [
        {"number": "3"},
        {"number": True},
        {"number": 3.0},
        {"parts": []},
        {"parts": {"a": None}},
        {"parts": {"a": {"share": "1"}}},
        {"parts": {"a": {"share": 1, "names": [1]}}},
        {"parts": {"a": {"names": []}}},
        {"note": 3},
        {"unheard": 1},
    ],
)
def test_another_type_anywhere_inside_is_refused(change: dict[str, object]) -> None:
    with pytest.raises((TypeError, ValueError)):
        typed(Outer, {**WHOLE, **change})


@pytest.mark.parametrize(
    "error",
    [KeyError("a"), TypeError("x"), OverflowError("y"), ValueRangeError("z", 1, "two")],
)
def test_errors_raised_by_content_become_one_sentence(error: Exception) -> None:
    expected = pytest.raises(FormatError, match=r"f\.json: a part is not right \(.*\); two")
    with expected, reading("f.json", "a part", "two"):
        raise error


def test_an_error_sentence_does_not_change() -> None:
    with pytest.raises(FormatError, match="g: h; i"), reading("f", "a", "b"):
        raise FormatError("g", "h", "i")


@pytest.mark.parametrize(
    "text", ["[1]", "3", "null", "{", "[" * 3000 + "]" * 3000, "\ud800", 3, None]
)
def test_a_text_that_is_no_json_object_is_refused(text: object) -> None:
    with pytest.raises(FormatError, match="config"):
        json_object("f", text, "config")


def test_half_a_character_in_json_is_refused_and_a_whole_one_read() -> None:
    assert json_value("f", b'{"a": "\\ud83d\\ude00"}') == {"a": "\N{GRINNING FACE}"}
    for half in (b'"\\ud800"', b'{"\\uDC00": 1}'):
        with pytest.raises(FormatError, match="surrogates not allowed"):
            json_value("f", half)


def test_json_within_the_limits_is_read_and_larger_json_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert json_value("f", b'{"a": [1, 2]}') == {"a": [1, 2]}
    assert json_value("f", b'\xef\xbb\xbf{"a": [1, 2]}') == {"a": [1, 2]}
    deep = ("[" * 101 + "]" * 101).encode()
    with pytest.raises(FormatError, match="too deep"):
        json_value("f", deep)
    monkeypatch.setattr(contents, "MAX_JSON_VALUES", 10)
    with pytest.raises(FormatError, match="at most 10 are read"):
        json_value("f", json.dumps([1] * 20).encode())


@pytest.mark.parametrize("levels", [1, 3])
def test_levels_count_nested_lists_and_mappings(levels: int) -> None:
    content: object = 1
    for _ in range(levels):
        content = {"a": [content]}
    assert not is_deep(content, 2 * levels)
    assert is_deep(content, 2 * levels - 1)


def test_a_part_that_is_no_mapping_is_read_as_empty() -> None:
    assert mapping_in({"a": {"b": 1}}, "a") == {"b": 1}
    assert mapping_in({"a": 1}, "a") == mapping_in([], "a") == mapping_in(None, "a") == {}
