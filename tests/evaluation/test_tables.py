"""Tables and page of a report."""

from pipelines.evaluation.figures import report_rows
from pipelines.evaluation.records import FrameRecord, JudgedPredictions, RowRecord
from pipelines.evaluation.tables import Table, report_page, report_tables
from pipelines.metrics.grasp_verdicts import Verdict

RECORD = FrameRecord(
    "f",
    "seen",
    0.1,
    JudgedPredictions(1, [0.9], {"0.5": [1]}),
    {"ours": RowRecord([Verdict(0, "held", 0.5, 0.5, 0.8, 0.7), Verdict(1, "no grasp")])},
)
TABLES = report_tables(report_rows([RECORD], (0.25,), 0.05))


def test_a_table_has_a_cell_for_every_head():
    assert all(len(row) == len(table.header) for table in TABLES for row in table.rows)


def test_splits_without_frames_are_left_out():
    assert {row[1] for row in TABLES[0].rows} == {"seen", "all"}


def test_means_have_three_digits_and_what_is_unknown_a_dash():
    assert TABLES[0].rows[0][2] == "0.250"
    assert TABLES[2].rows[1][2] == "-"


def test_a_page_escapes_what_it_is_given():
    page = report_page("a < b", [Table("<script>", ("x",), (("&",),))])
    assert "<script>" not in page
    assert "a &lt; b" in page
    assert "<td>&amp;</td>" in page
