"""Text that the documentation's build makes from code."""

import inspect
import re
from types import SimpleNamespace

import pytest

import symgrasp
from pipelines.configs.settings import settings_of
from pipelines.configs.stages import STAGE_SETTINGS, default_settings
from tools import docs_reference, docs_site


def made(uri: str, markdown: str) -> str:
    page = SimpleNamespace(file=SimpleNamespace(src_uri=uri))
    return docs_site.on_page_markdown(markdown, page, None, None)


def test_every_command_and_option_is_on_the_page_of_commands():
    sections = f"\n{docs_reference.commands()}".split("\n## ")[1:]
    texts = dict(section.split("\n", 1) for section in sections)
    assert list(texts) == docs_reference.NAMES
    for name, command in docs_reference.get_command(docs_reference.app).commands.items():
        shown = [p for p in command.params if p.name != "help" and not getattr(p, "hidden", False)]
        options = [opt for p in shown for opt in p.opts]
        assert all(f"`{opt}`" in texts[name] for opt in options if opt.startswith("--"))


def test_every_setting_is_on_the_page_of_settings():
    text = docs_reference.settings()
    for stage in STAGE_SETTINGS:
        for each in settings_of(default_settings(stage)):
            assert f"`{each.name}`" in text
            assert each.declaration.origin in text


def test_every_public_name_is_on_the_page_of_the_api():
    text = docs_reference.api()
    for name in symgrasp.__all__:
        assert f"\n## {name}\n" in f"\n{text}" or name.startswith("__")


def test_text_after_the_attributes_of_a_class_is_whole():
    text = docs_reference.api()
    for name in symgrasp.__all__:
        lines = inspect.getdoc(getattr(symgrasp, name)) or "" if not name.startswith("__") else ""
        assert all(line in text for line in re.findall(r"^[A-Z][^:]*$", lines, re.MULTILINE)), name


@pytest.mark.parametrize(
    ("uri", "link"),
    [
        ("index.md", "[D. 82](decisions/0082-grasp-critic.md)"),
        ("method/selection.md", "[D. 82](../decisions/0082-grasp-critic.md)"),
    ],
)
def test_citations_become_links_relative_to_the_page(uri, link):
    assert made(uri, "See D. 82.\n\n```\nD. 82\n```") == f"See {link}.\n\n```\nD. 82\n```"


def test_a_record_lists_the_code_that_cites_it_and_does_not_link_to_itself():
    text = made("decisions/0082-grasp-critic.md", "# 82. The title of D. 82")
    assert "[D. 82]" not in text
    assert "* `pipelines/grasping/" in text


def test_lists_nest_as_python_markdown_asks():
    text = "* a\n  * b\n    more\n\n```\n  code\n```"
    assert made("index.md", text) == "* a\n    * b\n        more\n\n```\n  code\n```"
