"""Figures that two pages state: the README, the page of the weights and the benchmark history."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
WEIGHTS = (ROOT / "pipelines" / "weights" / "README.md").read_text(encoding="utf-8")
EXPERIMENTS = ROOT / "docs" / "experiments"
HISTORY = (EXPERIMENTS / "benchmark-history.md").read_text(encoding="utf-8")
INDEX = (EXPERIMENTS / "index.md").read_text(encoding="utf-8")
SPLITS = ("seen", "similar", "novel", "all")


def cells_of(page: str, *first: str) -> list[str]:
    """Return the cells that follow the cells `first` in the one such row of a page's tables."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines()]
    (found,) = [row[len(first) :] for row in rows if row[: len(first)] == list(first)]
    return found


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize(
    ("name", "column"), [("grasp quality", 0), ("antipodal score", 1), ("region mask AP50", 3)]
)
def test_figures_of_the_weights_are_those_of_the_readme(split, name, column):
    stated = cells_of(README, name)[SPLITS.index(split)]
    assert cells_of(WEIGHTS, "ours", split)[column] == stated


@pytest.mark.parametrize("split", SPLITS)
def test_symmetry_ap_of_the_weights_is_that_of_the_readme(split):
    stated = cells_of(README, "symmetry AP, planes / axes")[SPLITS.index(split)]
    assert cells_of(WEIGHTS, "ours", split)[2].rsplit(" / ", 1)[0] == stated


@pytest.mark.parametrize(
    ("row", "name"),
    [
        ("oracle", "true symmetry and affordance: quality"),
        ("planar", "planar grasps, no symmetry, ranked by Eq. 8: quality"),
        ("planar + critic", "planar grasps, ranked by the grasp critic as ours: quality"),
    ],
)
def test_qualities_of_other_rows_are_those_of_the_readme(row, name):
    assert cells_of(WEIGHTS, row, "all")[0].split(" ")[0] == cells_of(README, name)[-1]


def test_the_newest_state_of_the_history_is_that_of_the_readme():
    newest = HISTORY.split("|---|---|---|\n", 1)[1].splitlines()[0].strip("|").split("|")[1:]
    figures = [cells_of(README, name) for name in ("grasp quality", "antipodal score")]
    assert [each.strip() for each in newest] == [
        f"{row[-1].split(' ')[0]} ({row[0]})" for row in figures
    ]


def test_the_share_held_in_simulation_is_that_of_the_readme():
    rate, low, high = re.search(r"grasps hold (\d+) % \((\d+) to (\d+)\)", README).groups()
    (held,) = [line for line in WEIGHTS.splitlines() if re.match(r"\| ours \| \d+ \(", line)]
    assert held.rstrip("| ").endswith(f"{rate} ({low} to {high})")


def test_the_seconds_of_a_frame_are_those_of_the_page_on_speed_and_of_the_index():
    (paragraph,) = re.findall(r"^\*\*Speed\.\*\* .+?\n\n", README, re.MULTILINE | re.DOTALL)
    seconds = re.findall(r"\d\.\d+(?= s\b| to )", paragraph)
    assert seconds
    (row,) = re.findall(r"^\| \[Speed\]\(speed\.md\) .+$", INDEX, re.MULTILINE)
    page = (EXPERIMENTS / "speed.md").read_text(encoding="utf-8")
    for each in seconds:
        assert f"{each} s" in row
        assert re.search(rf"\b{re.escape(each)} s\b", page)


def test_the_figures_of_posed_real_objects_are_those_of_the_page_of_compared_methods():
    stated = re.search(r"48 objects of real frames [^.]+ are\s(\d\.\d+) and (\d\.\d+)\.", README)
    page = (EXPERIMENTS / "baselines.md").read_text(encoding="utf-8")
    section = page.split("## On dev and on real frames", 1)[1].split("\n## ", 1)[0]
    assert cells_of(section, "SymGrasp") == list(stated.groups())
    (row,) = re.findall(r"^\| \[Compared methods\].+$", INDEX, re.MULTILINE)
    assert f"SymGrasp {stated[1]} |" in row
    assert f"SymGrasp {stated[1]}." in page.split("\n## ", 1)[0]
