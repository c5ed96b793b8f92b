"""Tables on the terminal: one line a row where there is room, columns close where there is not."""

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
