"""Digests of frames' files: computed late, and reused while a file is unchanged."""

import os
import pickle
from pathlib import Path

import pytest

from pipelines.frames import frame_inputs as module
from pipelines.frames.frame_inputs import UNREADABLE, FrameInputs
from pipelines.storage.provenance import digest


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, ...]:
    paths = tmp_path / "rgb/0.png", tmp_path / "depth/0.png"
    for index, path in enumerate(paths):
        path.parent.mkdir()
        path.write_text(f"image {index}")
    return paths


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that were read for their digests."""
    seen: list[Path] = []
    module._digest.cache_clear()
    monkeypatch.setattr(module, "digest", lambda path: seen.append(path) or digest(path))
    return seen


def stamp_of(inputs: FrameInputs) -> dict:
    return {"inputs": dict(inputs), "recorded": {"files": inputs.signatures()}}


def test_no_file_is_read_before_its_digest_is_needed(
    files: tuple[Path, ...], read: list[Path]
) -> None:
    inputs = pickle.loads(pickle.dumps(FrameInputs({"weights": "w"}, files)))
    assert list(inputs) == ["weights", "0 0.png", "1 0.png"]
    assert (inputs["weights"], len(inputs), read, inputs.are_known) == ("w", 3, [], False)
    assert inputs["1 0.png"] == digest(files[1])
    assert (dict(inputs)["0 0.png"], read) == (digest(files[0]), list(files))


def test_a_file_of_many_frames_is_read_once(files: tuple[Path, ...], read: list[Path]) -> None:
    for _ in range(5):
        dict(FrameInputs({}, files[:1]))
    assert read == [files[0]]


def test_digests_of_unchanged_files_are_reused(files: tuple[Path, ...], read: list[Path]) -> None:
    stamp = stamp_of(FrameInputs({}, files))
    read.clear()
    module._digest.cache_clear()
    again = FrameInputs({}, files)
    again.take_over(stamp)
    assert (dict(again), read) == (stamp["inputs"], [])


@pytest.mark.parametrize("change", ["size", "time", "gone", "record"])
def test_digests_of_changed_files_are_computed_again(
    files: tuple[Path, ...], read: list[Path], change: str
) -> None:
    stamp = stamp_of(FrameInputs({}, files))
    match change:
        case "size":
            files[0].write_text("a longer image")
        case "time":
            os.utime(files[0], ns=(1, 1))
        case "gone":
            files[0].unlink()
        case "record":
            del stamp["recorded"]
    again = FrameInputs({}, files)
    again.take_over(stamp)
    assert not again.are_known
    now = digest(files[0]) if files[0].exists() else UNREADABLE
    assert again["0 0.png"] == now
    again = FrameInputs({}, files)
    again.take_over(stamp, unchecked=True)  # results of this run stay valid
    assert dict(again) == stamp["inputs"]


@pytest.mark.parametrize("stamp", [{}, {"inputs": 3}, {"inputs": {}, "recorded": 3}])
def test_a_stamp_of_another_form_gives_no_digests(files: tuple[Path, ...], stamp: dict) -> None:
    inputs = FrameInputs({}, files)
    inputs.take_over(stamp)
    assert not inputs.are_known
    nothing = FrameInputs({}, ())
    nothing.take_over(stamp)
    assert dict(nothing) == {}
