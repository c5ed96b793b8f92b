"""Records of a scene survive being written and read."""

import pytest

from pipelines.errors import FormatError
from pipelines.evaluation.runs.records import (
    FrameRecord,
    RowRecord,
    ScoredPredictions,
    number_key,
    read_frame_records,
    write_frame_records,
)
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import is_finished, make_stamp

STAMP = make_stamp("evaluate", {"a": 1})
RECORD = FrameRecord(
    "scenes/scene_0100/kinect/0000",
    "seen",
    0.25,
    ScoredPredictions(2, [0.9], {"0.5": [1]}),
    {
        "second": RowRecord([], masks=ScoredPredictions(2, [0.8], {"0.5": [0]})),
        "ours": RowRecord(
            [Verdict(3, "held", 0.7, 0.3, 0.9, 0.8), Verdict(4, "no contact")],
            {"sphere": ScoredPredictions(1, [0.5], {"0.05": [0]})},
        ),
    },
)


def test_records_read_as_they_were_written(tmp_path):
    write_frame_records(tmp_path / "scene.json", [RECORD], STAMP)
    assert read_frame_records(tmp_path / "scene.json") == [RECORD]


def test_regions_of_other_files_are_unknown_in_older_records(tmp_path):
    write_frame_records(tmp_path / "scene.json", [RECORD], STAMP)
    content = read_json(tmp_path / "scene.json")
    for row in content["frames"][0]["rows"].values():
        del row["masks"]
    write_json(tmp_path / "scene.json", content)
    (older,) = read_frame_records(tmp_path / "scene.json")
    assert older.masks_of("second") is None
    assert older.masks_of("ours") == older.masks_of("oracle") == RECORD.masks
    assert RECORD.masks_of("second").confidence == [0.8]


def test_written_records_are_finished_for_their_stamp(tmp_path):
    write_frame_records(tmp_path / "scene.json", [RECORD], STAMP)
    assert is_finished(tmp_path / "scene.json", STAMP)


def test_another_json_file_is_refused(tmp_path):
    write_json(tmp_path / "scene.json", {"rows": []})
    with pytest.raises(FormatError, match="the record of a scene is not right"):
        read_frame_records(tmp_path / "scene.json")


def test_thresholds_are_named_by_their_written_form():
    assert [number_key(t) for t in (0.25, 0.067, 0.5)] == ["0.25", "0.067", "0.5"]
