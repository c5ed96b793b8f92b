"""Records of simulated trials read as they were written."""

import pytest

from pipelines.errors import FormatError
from pipelines.evaluation.runs.trial_records import (
    FrameTrials,
    Outcome,
    TrialRecord,
    read_trials,
    write_trials,
)
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import make_stamp

TRIALS = [TrialRecord(3, "sphere", {"0.3": Outcome("turned", 0.01, 20.0), "0.5": Outcome("held")})]
FRAMES = [
    FrameTrials("a", "seen", 0.001, TRIALS, {"oracle": TRIALS, "random": []}),
    FrameTrials("b", "novel", 0.0, []),
]


def test_trials_read_as_they_were_written(tmp_path):
    path = tmp_path / "trials.json"
    write_trials(path, FRAMES, make_stamp("test", {}))
    assert read_trials(path) == FRAMES
    assert list(read_trials(path)[0].rows) == ["ours", "oracle", "random"]


def test_trials_of_our_method_alone_need_no_entry_for_others(tmp_path):
    path = tmp_path / "trials.json"
    write_trials(path, FRAMES[1:], make_stamp("test", {}))
    content = read_json(path)
    del content["frames"][0]["baselines"]
    write_json(path, content)
    assert read_trials(path) == FRAMES[1:]


@pytest.mark.parametrize(
    "content",
    [
        [],
        {"frames": [{"name": "a"}]},
        {"frames": [{"name": "a", "split": "seen", "shift": 0.0, "trials": [], "baselines": []}]},
    ],
)
def test_a_file_that_holds_no_trials_is_refused(tmp_path, content):
    write_json(tmp_path / "x.json", content)
    with pytest.raises(FormatError, match="the record of a scene's trials is not right"):
        read_trials(tmp_path / "x.json")
