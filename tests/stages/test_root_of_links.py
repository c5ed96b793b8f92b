"""A root of links to a dataset that is only read; annotations are written next to the links."""

from pathlib import Path

from pipelines.annotation.jobs import OptionalInputs, items_of
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build


def test_a_root_of_links_is_read_and_annotated_next_to_the_links(tmp_path: Path) -> None:
    data, work = tmp_path / "data", tmp_path / "work"
    build.graspnet_scene(data / "scenes/scene_0100/kinect")
    (data / "models/007").mkdir(parents=True)
    (data / "models/007/nontextured.ply").write_bytes(b"ply")
    work.mkdir()
    for name in ("scenes", "models"):
        (work / name).symlink_to(data / name)
    assert [source.name for source in find_frames(work)] == [
        "scenes/scene_0100/kinect/0000",
        "scenes/scene_0100/kinect/0001",
    ]
    assert GraspNetRoot.finished(work).scenes("kinect", "seen")[0].frame_ids == [0, 1]
    (item,) = items_of(work, None, AnnotateSymmetryConfig(), 0, OptionalInputs())
    assert item.target == work / "symmetry/007.json"
