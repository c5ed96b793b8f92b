"""Tables of a report."""

import pytest

from pipelines.evaluation.reports.figures import report_rows
from pipelines.evaluation.reports.tables import Table, report_tables
from pipelines.evaluation.runs.bootstrap_units import VIEWS_NOTE
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.evaluation.runs.tallies import ReportTally
from pipelines.metrics.grasp_verdicts import Verdict


def record(split: str, qualities: list[float]) -> FrameRecord:
    held = [Verdict(i, "held", q, 1 - q, 0.8, 0.7) for i, q in enumerate(qualities)]
    rows = {"ours": RowRecord([*held, Verdict(9, "no grasp")])}
    return FrameRecord("f", split, 0.1, ScoredPredictions(1, [0.9], {"0.5": [1]}), rows)


def report(*records: FrameRecord, **more) -> dict:
    return {"rows": report_rows(ReportTally.of(records), (0.25,), 0.05), **more}


def table_of(tables: list[Table], start: str) -> Table:
    return next(table for table in tables if table.title.startswith(start))


def cell(table: Table, method: str, column: str) -> str:
    row = next(row for row in table.rows if row[0] == method)
    return row[table.header.index(column)]


TABLES = report_tables(report(record("seen", [0.5])))


def test_a_table_has_a_cell_for_every_head():
    assert all(len(row) == len(table.header) for table in TABLES for row in table.rows)


def test_the_papers_rows_come_first_and_are_counted():
    table = table_of(TABLES, "Table I.")
    assert table.published == 5
    assert table.rows[4][:3] == ("SymmetryGrasp", "0.382", "0.297")
    assert table.rows[5][0] == "SymGrasp"
    assert "paper" in table.note


def test_both_antipodal_scores_are_named_apart():
    titles = [table.title for table in TABLES if "ntipodal" in table.title]
    assert len(titles) == 2
    assert "contact pair" in titles[0]
    assert "closing region" in titles[1]


def test_means_have_three_digits_and_unknown_values_are_a_dash():
    table = table_of(TABLES, "Table I.")
    assert cell(table, "SymGrasp", "seen") == "0.250"
    assert cell(table, "SymGrasp", "unseen") == "-"


def test_ap_by_graspnets_protocol_is_in_percent_and_absent_from_older_reports():
    one = record("seen", [0.5])
    one.rows["ours"].accuracy.extend([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    table = table_of(report_tables(report(one)), "Average precision of grasps")
    assert cell(table, "SymGrasp", "AP") == "25.0"
    assert cell(table, "SymGrasp", "AP 0.8") == "30.0"
    assert not any("of grasps" in each.title for each in TABLES)


def test_unseen_is_the_mean_over_the_objects_of_both_splits():
    pooled = report(record("similar", [0.9]), record("novel", [0.3, 0.6, 0.6]))
    table = table_of(report_tables(pooled), "Table I.")
    assert float(cell(table, "SymGrasp", "unseen")) == pytest.approx(2.4 / 6)
    assert float(cell(table, "SymGrasp, if grasped", "unseen")) == pytest.approx(2.4 / 4)


@pytest.mark.parametrize(
    ("thresholds", "sphere", "note"),
    [
        (
            [0.25, 0.134],
            0.05,
            "below 0.25, or a sphere's centre within 5 cm; the last rows have st",
        ),
        (
            [0.1, 0.3, 0.05],
            0.02,
            "below 0.1, or a sphere's centre within 2 cm; the last rows have o",
        ),
        ([0.1], 0.005, "below 0.1, or a sphere's centre within 0.5 cm."),
    ],
)
def test_the_table_of_symmetries_states_the_thresholds_that_were_used(thresholds, sphere, note):
    config = {"symmetry_thresholds": thresholds, "sphere_threshold": sphere}
    made = report(record("seen", [0.5]), provenance={"config": config})
    assert note in table_of(report_tables(made), "Symmetry").note


@pytest.mark.parametrize("title", ["Table I.", "Table II.", "Symmetry"])
def test_tables_state_the_unit_of_their_intervals_which_older_reports_lack(title):
    one = record("seen", [0.5])
    by_scene = table_of(report_tables(report(one, interval_unit="scene")), title).note
    assert "bootstrap over scenes" in by_scene
    older = table_of(report_tables(report(one)), title).note
    assert "bootstrap over frames" in older
    assert VIEWS_NOTE in older


def test_splits_without_frames_have_no_row():
    assert {row[1] for row in table_of(TABLES, "Outcomes of the objects").rows} == {"seen", "all"}


def test_a_report_without_simulated_success_names_the_command_for_it():
    assert "symgrasp simulate" in table_of(TABLES, "Table III").note


def test_success_has_a_row_a_friction_and_a_row_a_split():
    rate = {"trials": 20, "held": 15, "rate": 0.75, "low": 0.531, "high": 0.888}
    missing = {"trials": 0, "held": 0, "rate": None, "low": None, "high": None}
    found = {"sphere": {"0.5": rate, "0.3": missing}}
    simulated = report(record("seen", [0.5]), success_by_friction={"all": found, "novel": found})
    table = table_of(report_tables(simulated), "Table III")
    ours = {row[:3]: row for row in table.rows[table.published :]}
    assert list(ours) == [
        ("SymGrasp", "0.3", "all"), ("SymGrasp", "0.5", "all"), ("SymGrasp", "0.5", "novel"),
    ]  # fmt: skip
    assert ours["SymGrasp", "0.5", "all"][table.header.index("sphere")] == "75 (53-89)"
    assert ours["SymGrasp", "0.3", "all"][table.header.index("sphere")] == "-"
    assert "sphere 20" in table.note


def test_success_of_other_methods_stands_below_ours():
    rate = {"trials": 20, "held": 15, "rate": 0.75, "low": 0.531, "high": 0.888}
    other = {"trials": 10, "held": 2, "rate": 0.2, "low": 0.057, "high": 0.51}
    simulated = report(
        record("seen", [0.5]),
        success_by_friction={"all": {"all": {"0.5": rate}}},
        success_baselines={
            "random": {
                "success": {split: {"all": {"0.5": other}} for split in ("seen", "all")},
                "reasons": {"all": {"0.5": {"held": 2, "dropped": 8}}},
            }
        },
    )
    tables = report_tables(simulated)
    rows = [
        (*row[:3], row[-1])
        for row in table_of(tables, "Table III").rows
        if row[0] in ("SymGrasp", "random")
    ]
    assert rows == [
        ("SymGrasp", "0.5", "all", "75 (53-89)"),
        ("random", "0.5", "all", "20 (6-51)"),
        ("random", "0.5", "seen", "20 (6-51)"),
    ]
    assert "SymGrasp: all 20" in table_of(tables, "Table III").note
    became = table_of(tables, "Outcomes of the simulated")
    assert became.rows == (("random", "0.5", "80", "20"),)


def test_outcomes_of_trials_are_in_percent_of_all_trials():
    counts = {"all": {"0.5": {"held": 3, "slipped": 1}}}
    simulated = report(record("seen", [0.5]), success_reasons=counts)
    table = table_of(report_tables(simulated), "Outcomes of the simulated")
    assert table.header == ("method", "mu", "slipped", "held")
    assert table.rows == (("SymGrasp", "0.5", "25", "75"),)
