"""Tables: one line a row where there is room, columns close on a terminal without."""

import pytest

from pipelines.evaluation.tables import Table
from symgrasp_cli.report import show_table

HEADER = ("method", "mu", "split", "reflection", "rotation", "sphere", "none", "all")
RATES = ("66 (58-72)", "73 (67-79)", "100 (76-100)", "75 (55-88)", "71 (66-75)")
TABLE = Table("Table III", HEADER, (("SymGrasp", "0.5", "similar", *RATES),), names=3)


@pytest.mark.parametrize(("columns", "gap"), [(80, " "), (120, "  ")])
def test_a_row_stays_on_its_line(monkeypatch, capsys, columns, gap):
    monkeypatch.setenv("COLUMNS", str(columns))
    show_table(TABLE)
    assert gap.join(["SymGrasp", "0.5", "similar", *RATES]) in capsys.readouterr().out


def test_a_pipe_is_as_wide_as_the_table(monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    row = ("a name of a run that is as long as names of runs are", "0.5", "similar", *RATES)
    show_table(Table("Table III", HEADER, (row,), names=3))
    assert "  ".join(row) in capsys.readouterr().out
