"""Decision records, docs/decisions/NNNN-title.md: reader, index, and the code that cites them."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FOLDERS = ("pipelines", "symgrasp", "symgrasp_cli", "tools", "benchmarks")
CITATION = re.compile(r"\bD\.\s+(\d+)\b")
ENTRY = re.compile(r"^\* (\w+): ((?:.+\n)(?:  .+\n)*)", re.MULTILINE)


@dataclass(frozen=True)
class Record:
    """One decision.

    Attributes:
        number: number in citations, `D. 82`.
        title: title without the number.
        path: path of the file.
        header: entries of the list at the top, such as `Status` and `Subject`.
        text: the whole file.
    """

    number: int
    title: str
    path: Path
    header: dict[str, str]
    text: str


def read_records(root: Path) -> list[Record]:
    """Return the records of `root`/docs/decisions by number."""
    return [_read(path) for path in sorted((root / "docs" / "decisions").glob("[0-9]*.md"))]


def _read(path: Path) -> Record:
    text = path.read_text(encoding="utf-8")
    head = re.match(r"# (\d+)\. (.+)\n", text)
    if head is None:
        raise ValueError(f"{path}: first line is no title such as '# 82. Title'")
    header = {name: " ".join(value.split()) for name, value in ENTRY.findall(text)}
    return Record(int(head[1]), head[2], path, header, text)


def records_tables(records: Iterable[Record]) -> str:
    """Return a table of records for each subject, as Markdown."""
    subjects: dict[str, list[Record]] = {}
    for record in records:
        subjects.setdefault(record.header["Subject"], []).append(record)
    lines: list[str] = []
    for subject in sorted(subjects):
        lines += [f"## {subject.capitalize()}", "", "| record | title | status |", "|---|---|---|"]
        for each in subjects[subject]:
            lines.append(f"| D. {each.number} | {each.title} | {each.header['Status']} |")
        lines.append("")
    return "\n".join(lines)


def source_files(root: Path) -> Iterator[Path]:
    """Yield the project's own source files."""
    for folder in FOLDERS:
        yield from sorted((root / folder).rglob("*.py"))


def cited_in(root: Path, number: int) -> list[str]:
    """Return the source files that cite decision `number`, relative to `root`."""
    return _citations(root).get(number, [])


@cache
def _citations(root: Path) -> dict[int, list[str]]:
    found: dict[int, list[str]] = {}
    for path in source_files(root):
        text = path.read_text(encoding="utf-8")
        for number in sorted({int(each) for each in CITATION.findall(text)}):
            found.setdefault(number, []).append(path.relative_to(root).as_posix())
    return found
