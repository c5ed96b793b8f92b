"""The record of the paths of a `grasps.h5`'s frames: written, and found again."""

import json
from pathlib import Path

import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames_record import FramesRecord
from pipelines.storage.provenance import Stamp, make_stamp


def attributes(record: FramesRecord, grasps: Path) -> dict[str, str]:
    stamp = Stamp("infer", {}, recorded=record.beside(grasps))
    return {"provenance": stamp.as_text()}


def test_a_record_is_found_again_when_file_and_frames_move_together(tmp_path: Path) -> None:
    camera = CameraFile(500.0, 501.0, 319.5, 239.5)
    grasps = tmp_path / "old/out/grasps.h5"
    (tmp_path / "old/frames").mkdir(parents=True)
    attrs = attributes(FramesRecord(tmp_path / "old/frames", FrameOptions(camera, 5000.0)), grasps)
    assert str(tmp_path) not in attrs["provenance"]
    (tmp_path / "old").rename(tmp_path / "new")
    (tmp_path / "new/out").mkdir()
    back = FramesRecord.of(tmp_path / "new/out/grasps.h5", attrs)
    assert back.folder.resolve() == (tmp_path / "new/frames").resolve()
    assert back.stated == FrameOptions(camera, 5000.0)


def test_missing_or_unknown_frames_give_one_sentence_unless_a_folder_is_given(
    tmp_path: Path,
) -> None:
    grasps = tmp_path / "grasps.h5"
    attrs = attributes(FramesRecord(tmp_path / "frames", FrameOptions(None, 10.0)), grasps)
    with pytest.raises(FormatError, match="give --frames"):
        FramesRecord.of(grasps, attrs)
    with pytest.raises(FormatError, match="does not name"):
        FramesRecord.of(grasps, {"provenance": make_stamp("infer", {}).as_text()})
    given = FramesRecord.of(grasps, attrs, tmp_path / "elsewhere")
    assert given == FramesRecord(tmp_path / "elsewhere", FrameOptions(None, 10.0))


@pytest.mark.parametrize("record", [{"frames": ".", "camera": {"fx": 1}}, [1], {"frames": 7}])
def test_a_damaged_record_is_reported_in_one_sentence(tmp_path: Path, record: object) -> None:
    attrs = {"provenance": json.dumps({"recorded": record})}
    with pytest.raises(FormatError, match="damaged"):
        FramesRecord.of(tmp_path / "grasps.h5", attrs)


def test_the_stamp_holds_a_record_only_where_there_is_one() -> None:
    assert "recorded" not in Stamp("infer", {}).as_json()
    assert Stamp("infer", {}, recorded={"frames": "x"}).as_json()["recorded"] == {"frames": "x"}
