"""Hooks of the documentation build: text made from code, and links to decision records.

`mkdocs.yml` names this file. A page with `<!-- made from code: commands -->` gets the
description of the commands at this place; it is not stored, so pages and code cannot differ.
"""

import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.docs_records import CITATION, Record, cited_in, read_records, records_tables  # noqa: E402
from tools.docs_reference import api, commands, settings  # noqa: E402

MARK = re.compile(r"<!-- made from code: (\w+) -->")
MADE = {
    "api": api,
    "changelog": lambda: _from_root("CHANGELOG.md"),
    "commands": commands,
    "contributing": lambda: _from_root("CONTRIBUTING.md"),
    "records": lambda: records_tables(_records().values()),
    "settings": settings,
}
FENCE = re.compile(r"(^```.*?^```$)", re.DOTALL | re.MULTILINE)
LITERAL = re.compile(r"(```.*?```|`[^`\n]*`|\[[^\]]*\]\([^)]*\))", re.DOTALL)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:  # noqa: ANN401
    """Return the page with its parts from code, and with citations `D. 82` as links."""
    del config, files
    uri = page.file.src_uri
    text = MARK.sub(lambda match: MADE[match[1]](), markdown)
    text = "".join(part if part.startswith("```") else _nested(part) for part in FENCE.split(text))
    parts = LITERAL.split(text)
    parts[::2] = [CITATION.sub(lambda match: _link(match, uri), part) for part in parts[::2]]
    return "".join(parts) + _cited_in(uri)


def _nested(text: str) -> str:
    """Return `text` with four spaces for two: Python-Markdown nests lists by four spaces."""
    return re.sub(r"^(?: {2})+", lambda match: 2 * match[0], text, flags=re.MULTILINE)


def _from_root(name: str) -> str:
    """Return a document of the repository's root, with links of the site."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return text.replace("](docs/", "](").replace("](CHANGELOG.md)", "](changelog.md)")


@cache
def _records() -> dict[int, Record]:
    return {record.number: record for record in read_records(ROOT)}


def _link(match: re.Match[str], uri: str) -> str:
    name = _records()[int(match[1])].path.name
    if uri.endswith(f"/{name}"):
        return match[0]
    return f"[{match[0]}]({'../' * uri.count('/')}decisions/{name})"


def _cited_in(uri: str) -> str:
    """Return a list of the files that cite the record of page `uri`; no text for other pages."""
    match = re.fullmatch(r"decisions/(\d+)-.*\.md", uri)
    places = cited_in(ROOT, int(match[1])) if match else []
    return "\n\n## Cited in\n\n" + "".join(f"* `{path}`\n" for path in places) if places else ""
