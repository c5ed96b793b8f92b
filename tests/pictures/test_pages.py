"""Pages from templates: values are escaped, our own files are not, missing values are errors."""

from pathlib import Path

import pytest
from jinja2 import UndefinedError

from pipelines.pictures.pages import rendered


def page(folder: Path, template: str, **values: object) -> str:
    (folder / "a.html").write_text(template)
    return rendered(folder / "a.html", **values)


def test_values_are_escaped_in_text_and_in_attributes(tmp_path: Path) -> None:
    found = page(tmp_path, '<p title="{{ name }}">{{ name }}</p>', name="<script>&\"'")
    escaped = "&lt;script&gt;&amp;&#34;&#39;"
    assert found == f'<p title="{escaped}">{escaped}</p>'


def test_values_inside_a_script_cannot_end_it(tmp_path: Path) -> None:
    found = page(tmp_path, "<script>{{ scene | tojson }}</script>", scene={"a": "</script>"})
    assert found == '<script>{"a":"\\u003c/script\\u003e"}</script>'


def test_a_file_next_to_the_template_is_included_unchanged(tmp_path: Path) -> None:
    (tmp_path / "a.js").write_text("if (a < b && {{c}}) {}")
    found = page(tmp_path, "<script>{{ file('a.js') }}</script>")
    assert found == "<script>if (a < b && {{c}}) {}</script>"


def test_a_missing_value_is_an_error_and_not_a_gap(tmp_path: Path) -> None:
    with pytest.raises(UndefinedError, match="title"):
        page(tmp_path, "{{ title }}")
