"""Choice of frames of a folder: a split, a camera, every N-th frame."""

from pathlib import Path

import pytest

from pipelines.dataset.chosen_frames import ChosenFrames
from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for scene in ("scene_0000", "scene_0100", "scene_0131"):
        for camera in ("kinect", "realsense"):
            build.graspnet_scene(tmp_path / "scenes" / scene / camera)
    return tmp_path


def chosen(root: Path, **choice: object) -> list[str]:
    wanted = ChosenFrames(**choice)
    found = find_frames(root, camera=wanted.camera, scenes=wanted.scenes)
    return [source.name for source in wanted.of(found)]


def test_a_split_and_a_camera_are_chosen(root: Path) -> None:
    assert len(chosen(root)) == 3 * 2 * build.COUNT
    assert chosen(root, split="seen", camera="kinect") == [
        "scenes/scene_0100/kinect/0000",
        "scenes/scene_0100/kinect/0001",
    ]
    assert len(chosen(root, split="train")) == 2 * build.COUNT
    assert len(chosen(root / "scenes/scene_0131/kinect", split="similar")) == build.COUNT


def test_an_unknown_split_is_refused_with_all_names_that_options_take() -> None:
    with pytest.raises(UnknownNameError, match="known are all, novel, seen, similar, train"):
        ChosenFrames("sen")


def test_scenes_numbered_from_1000_are_in_their_split(root: Path) -> None:
    for scene in ("scene_1130", "scene_9159", "scene_1000"):
        build.graspnet_scene(root / "scenes" / scene / "kinect")
    names = chosen(root, split="similar", camera="kinect")
    scenes = list(dict.fromkeys(name.split("/")[1] for name in names))
    assert scenes == ["scene_0131", "scene_1130", "scene_9159"]


def test_every_n_th_frame_of_each_folder_is_chosen(root: Path) -> None:
    names = chosen(root, stride=2)
    assert len(names) == 6
    assert all(name.endswith("/0000") for name in names)


def test_a_split_without_frames_is_reported_in_one_sentence(root: Path) -> None:
    with pytest.raises(SymgraspError, match="holds no RGB-D frames"):
        chosen(root, split="novel")


@pytest.mark.parametrize("choice", [{"split": "test"}, {"camera": "zed"}, {"stride": 0}])
def test_unknown_choices_are_wrong_usage(choice: dict) -> None:
    with pytest.raises(SymgraspError) as caught:
        ChosenFrames(**choice)
    assert caught.value.exit_code == 2
