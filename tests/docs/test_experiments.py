"""Experiment pages: each begins with its question and answer, which the index repeats."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "experiments"
PAGES = sorted(path for path in FOLDER.glob("*.md") if path.name != "index.md")
INDEX = (FOLDER / "index.md").read_text(encoding="utf-8")
ROWS = {page: cells for page, cells in re.findall(r"^\| \[.+?\]\((\S+)\) \| (.+) \|$", INDEX, re.M)}
MAX_LINES = 5


def opening_of(page: Path) -> str:
    """Return the first paragraph after the title and the list of records."""
    paragraphs = page.read_text(encoding="utf-8").split("\n\n")
    return paragraphs[2] if paragraphs[1].startswith("Record") else paragraphs[1]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_page_begins_with_its_question_and_answer(page):
    opening = opening_of(page)
    assert re.match(r"\*\*Question\.\*\* [^*]+[?.]\s\*\*Answer\.\*\*\s\S", opening)
    assert len(opening.splitlines()) <= MAX_LINES


def test_the_index_has_a_question_and_an_answer_of_each_page():
    assert sorted(ROWS) == [page.name for page in PAGES]
    lacking = [page for page, cells in ROWS.items() if not re.fullmatch(r".+\? \| \S.+", cells)]
    assert not lacking


def test_answers_of_the_index_repeat_figures_of_their_pages():
    for page, cells in ROWS.items():
        figures = re.findall(r"\d+(?:[.,]\d+)*", cells)
        text = (FOLDER / page).read_text(encoding="utf-8")
        absent = [each for each in figures if not re.search(rf"(?<![\d.]){each}(?!\d)", text)]
        assert not absent, (page, absent)
