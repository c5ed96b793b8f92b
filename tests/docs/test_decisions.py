"""Decision records: form, status, length, settings and citations."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipelines.configs.stages import default_settings
from tools import docs_records

ROOT = Path(__file__).resolve().parents[2]
RECORDS = docs_records.read_records(ROOT)
BY_NUMBER = {record.number: record for record in RECORDS}
MAX_WORDS = 150
MEASURED = re.compile(r"\b0\.\d{3}\b|±")


def setting(name: str) -> Any:
    """Return the default of a setting that records name as `stage: path.of.field`."""
    stage, path = name.split(": ")
    value = default_settings(stage)
    for step in path.split("."):
        value = getattr(value, step)
    return value


def settings_of(record: Any) -> list[str]:
    return re.findall(r"`([\w-]+: [\w.]+)`", record.header.get("Settings", ""))


def spellings(value: float) -> set[str]:
    """Return the spellings of a setting's number: plain, in percent, mm and cm."""
    numbers = (value, value * 100, value * 1000)
    return {f"{number:.6g}" for number in numbers if number not in {0, 1, 2, 3}}


def numbers_in(record: Any) -> set[str]:
    body = record.text.split("\n\n", 2)[-1]
    body = re.sub(r"\b(?:D\.|Sec\.|Eqs?\.|Fig\.|Table)\s+[\dIVX, to]+|`[^`]*`", "", body)
    return {match.rstrip(".") for match in re.findall(r"\d[\d.]*", body)}


def cited_files() -> Iterator[Path]:
    yield from docs_records.source_files(ROOT)
    yield from (ROOT / "docs").rglob("*.md")
    yield from ROOT.glob("*.md")
    yield from (ROOT / "tests").rglob("*.py")


def test_a_record_has_status_context_decision_and_consequence():
    for record in RECORDS:
        status = record.header["Status"]
        assert re.fullmatch(r"accepted|withdrawn|superseded by D\. \d+", status), record.path
        parts = re.findall(r"^\*\*(\w+)\.\*\*", record.text, re.MULTILINE)
        assert parts == ["Context", "Decision", "Consequence"], record.path
        assert record.header["Subject"], record.path
        assert record.path.name.startswith(f"{record.number:04d}-"), record.path


def test_a_record_has_at_most_150_words():
    words = {record.path.stem: len(record.text.split()) for record in RECORDS}
    assert not {stem: count for stem, count in words.items() if count > MAX_WORDS}


def test_a_record_names_settings_that_exist_and_repeats_none_of_their_numbers():
    for record in RECORDS:
        held: set[str] = set()
        for name in settings_of(record):
            value = setting(name)
            values = value if isinstance(value, tuple) else (value,)
            numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
            held |= set().union(*map(spellings, numbers))
        assert not held & numbers_in(record), record.path


def test_a_record_holds_no_measured_figures():
    assert not [record.path.stem for record in RECORDS if MEASURED.search(record.text)]


def test_every_citation_resolves():
    unknown = {
        (path.relative_to(ROOT).as_posix(), number)
        for path in cited_files()
        for number in docs_records.CITATION.findall(path.read_text(encoding="utf-8"))
        if int(number) not in BY_NUMBER
    }
    assert not unknown


def test_numbers_of_records_are_unique():
    assert len(BY_NUMBER) == len(RECORDS) >= 115
