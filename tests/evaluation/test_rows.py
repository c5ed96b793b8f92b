"""Rows of reports: names, titles, order."""

import pytest

from pipelines.evaluation.reports import published
from pipelines.evaluation.rows import KNOWN_ROWS, ordered_rows, report_row
from pipelines.evaluation.runs import other_runs


def test_rows_with_figures_in_the_paper_bear_its_name_of_the_method():
    tables = (published.GRASP_QUALITY, published.SYMMETRY_AP)
    known = {method for table in tables for method in table}
    named = {row.published for row in KNOWN_ROWS if row.published}
    assert {"Multi-Grasp", "GG-CNN"} <= named <= known


def test_a_compared_method_with_our_selection_has_a_separate_row():
    assert report_row("gg-cnn-selected").title == "GG-CNN + our selection"
    assert report_row("mine-selected").title == "mine-selected"


def test_rows_of_files_stand_before_the_baselines():
    assert ordered_rows(["random", "zzz", "gg-cnn", "oracle", "ours"]) == [
        "ours",
        "gg-cnn",
        "zzz",
        "oracle",
        "random",
    ]


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ("a", "lacks 1 of our frames, for example b"),
        ("abc", "has frames that ours lacks, for example c"),
        ("ba", "has our frames in another order, or some of them twice"),
        ("aab", "has our frames in another order, or some of them twice"),
    ],
)
def test_the_difference_of_another_run_is_named(names, sentence):
    assert other_runs._difference(names, "ab") == sentence
