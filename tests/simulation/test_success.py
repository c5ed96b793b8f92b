"""Rates are counted by split, kind and friction, and say what failed."""

import pytest

from pipelines.errors import FormatError
from pipelines.formats.files import write_json
from pipelines.formats.provenance import make_stamp
from pipelines.simulation.records import FrameTrials, TrialRecord, read_trials, write_trials
from pipelines.simulation.success import reasons, success_rates, success_tables
from pipelines.simulation.trial import Outcome


def trial(kind: str, *what: str) -> TrialRecord:
    outcomes = {key: Outcome(reason) for key, reason in zip(("0.3", "0.5"), what, strict=True)}
    return TrialRecord(3, kind, outcomes)


FRAMES = [
    FrameTrials(
        "a", "seen", 0.001, [trial("sphere", "held", "held"), trial("none", "turned", "held")]
    ),
    FrameTrials("b", "novel", 0.0, [trial("sphere", "collision", "dropped")]),
    FrameTrials("c", "novel", 0.0, []),
]
FRICTIONS = (0.3, 0.5)


def test_a_trial_counts_in_its_split_and_in_all_with_its_kind_and_in_all():
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
    assert reasons(FRAMES, FRICTIONS)["all"] == {
        "0.3": {"collision": 1, "turned": 1, "held": 1},
        "0.5": {"dropped": 1, "held": 2},
    }


def test_no_frames_make_no_rates_and_still_tables():
    content = {
        "frictions": list(FRICTIONS),
        "success": success_rates([], FRICTIONS),
        "reasons": reasons([], FRICTIONS),
    }
    assert content["success"]["all"]["all"]["0.3"]["rate"] is None
    assert success_tables(content)[0].rows == ()


def test_trials_read_as_they_were_written(tmp_path):
    path = tmp_path / "trials.json"
    write_trials(path, FRAMES, make_stamp("test", {}))
    assert read_trials(path) == FRAMES


def test_a_file_that_holds_no_trials_is_refused(tmp_path):
    write_json(tmp_path / "x.json", {"frames": [{"name": "a"}]})
    with pytest.raises(FormatError, match="not the trials of a scene"):
        read_trials(tmp_path / "x.json")
