"""Success rates by split, kind and friction, and counts of the reasons for failures."""

from dataclasses import replace

import pytest

from pipelines.evaluation.runs.trial_records import FrameTrials, Outcome, TrialRecord
from pipelines.simulation.success import (
    outcome_counts,
    success_rates,
    success_tables,
    write_success,
)
from pipelines.storage.files import read_json
from pipelines.storage.provenance import make_stamp


def trial(kind: str, *reasons: str) -> TrialRecord:
    outcomes = {key: Outcome(reason) for key, reason in zip(("0.3", "0.5"), reasons, strict=True)}
    return TrialRecord(3, kind, outcomes)


FRAMES = [
    FrameTrials(
        "a", "seen", 0.001, [trial("sphere", "held", "held"), trial("none", "turned", "held")]
    ),
    FrameTrials("b", "novel", 0.0, [trial("sphere", "collision", "dropped")]),
    FrameTrials("c", "novel", 0.0, []),
]
FRICTIONS = (0.3, 0.5)


def test_a_trial_counts_in_its_split_and_in_all_splits_for_its_kind_and_for_all_kinds():
    rates = success_rates(FRAMES, FRICTIONS)
    assert list(rates) == ["seen", "novel", "all"]
    found = {
        (split, kind): (cell["0.5"]["held"], cell["0.5"]["trials"])
        for split, kinds in rates.items()
        for kind, cell in kinds.items()
        if cell["0.5"]["trials"]
    }
    assert found == {
        ("seen", "sphere"): (1, 1), ("seen", "none"): (1, 1), ("seen", "all"): (2, 2),
        ("novel", "sphere"): (0, 1), ("novel", "all"): (0, 1),
        ("all", "sphere"): (1, 2), ("all", "none"): (1, 1), ("all", "all"): (2, 3),
    }  # fmt: skip
    assert rates["all"]["all"]["0.3"]["rate"] == pytest.approx(1 / 3)


def test_a_kind_without_trials_has_no_rate():
    cell = success_rates(FRAMES, FRICTIONS)["seen"]["rotation"]["0.3"]
    assert cell == {"trials": 0, "held": 0, "rate": None, "low": None, "high": None}


def test_reasons_are_counted_by_friction():
    assert outcome_counts(FRAMES, FRICTIONS)["all"] == {
        "0.3": {"collision": 1, "turned": 1, "held": 1},
        "0.5": {"dropped": 1, "held": 2},
    }


def test_no_frames_give_no_rates_but_tables():
    content = {
        "frictions": list(FRICTIONS),
        "success": success_rates([], FRICTIONS),
        "reasons": outcome_counts([], FRICTIONS),
    }
    assert content["success"]["all"]["all"]["0.3"]["rate"] is None
    assert success_tables(content)[0].rows == ()


def test_other_methods_have_separate_rates_and_ours_do_not_change(tmp_path):
    stamp, path = make_stamp("test", {}), tmp_path / "success.json"
    write_success(path, FRAMES, FRICTIONS, stamp)
    alone = read_json(path)
    assert alone["baselines"] == {}
    drawn = [[trial("none", "held", "held")], [trial("sphere", "dropped", "held")], []]
    frames = [replace(f, baselines={"random": t}) for f, t in zip(FRAMES, drawn, strict=True)]
    write_success(path, frames, FRICTIONS, stamp)
    content = read_json(path)
    assert {**content, "baselines": {}} == alone
    random = content["baselines"]["random"]
    assert random["success"]["all"]["all"]["0.3"]["held"] == 1
    assert random["success"]["seen"]["sphere"]["0.5"]["trials"] == 0
    assert random["reasons"]["novel"]["0.3"] == {"dropped": 1}


def test_all_methods_are_listed_below_each_other_in_every_split():
    frames = [replace(FRAMES[0], baselines={"oracle": [trial("sphere", "dropped", "held")]})]
    content = {
        "frictions": list(FRICTIONS),
        "success": success_rates(frames, FRICTIONS),
        "reasons": outcome_counts(frames, FRICTIONS),
        "baselines": {"oracle": {"success": success_rates(frames, FRICTIONS, "oracle")}},
    }
    *_, table = success_tables(content)
    assert [row[:2] for row in table.rows] == [
        ("SymGrasp", "seen"), ("SymGrasp", "all"), ("oracle", "seen"), ("oracle", "all"),
    ]  # fmt: skip
    assert table.rows[-1][2:] == ("0 [0-79]", "100 [21-100]")
