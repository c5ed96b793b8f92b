"""Digests of a dumped scene, which change with the inputs of its verdicts and nothing else."""

import shutil
from pathlib import Path

import pytest

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.evaluation.graspnet.graspnet_truth import InputDigests
from pipelines.frames.graspnet_scene import annotated_ids
from pipelines.grasp_files.exports.graspnet_dump import dumped_scenes
from tests.stages import toy_root
from tests.stages.toy_dump import write_dump, write_root

PARTS = {
    "dump": "dump/scene_0100/realsense/0001.npy",
    "poses": "root/scenes/scene_0100/realsense/annotations/0001.xml",
    "meshes": "root/models/001/nontextured.ply",
}
TABLE = "root/scenes/scene_0100/realsense/cam0_wrt_table.npy"
META = "root/scenes/scene_0100/realsense/meta/0000.mat"
SURFACE = "root/models/001/textured.obj"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    write_root(folder / "root")
    write_dump(folder / "dump")
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


def digests(folder: Path, *, exact: bool = False) -> list[dict[str, str]]:
    """Return the digests of every dumped scene, the hundredth first."""
    of_root = InputDigests(GraspNetRoot(folder / "root"), exact=exact)
    return [of_root.of(scene) for scene in dumped_scenes(folder / "dump")]


def touched(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b" ")


@pytest.mark.parametrize("kind", PARTS)
def test_each_kind_of_input_has_its_digest(folder, kind):
    before = digests(folder)[0]
    touched(folder / PARTS[kind])
    after = digests(folder)[0]
    assert {name for name in before if before[name] != after[name]} == {kind}


@pytest.mark.parametrize(
    ("file", "matters", "matters_exactly"),
    [
        ("root/models/001/nontextured.ply", True, False),
        (SURFACE, True, True),
        (TABLE, True, True),
        (META, False, True),
        ("root/scenes/scene_0100/realsense/camera_poses.npy", True, True),
        ("root/scenes/scene_0100/realsense/depth/0000.png", False, False),
    ],
)
def test_files_that_are_not_read_do_not_change_the_digests(folder, file, matters, matters_exactly):
    before = [digests(folder), digests(folder, exact=True)]
    touched(folder / file)
    after = [digests(folder), digests(folder, exact=True)]
    changes = [b != a for b, a in zip(before, after, strict=True)]
    assert changes == [matters, matters_exactly]


def test_a_grid_next_to_the_mesh_is_read_in_its_place(folder):
    before = [digests(folder), digests(folder, exact=True)]
    (folder / SURFACE).with_suffix(".sdf").write_text("a grid")
    after = [digests(folder), digests(folder, exact=True)]
    assert (before[0] != after[0], before[1] != after[1]) == (True, False)
    touched(folder / SURFACE)
    assert digests(folder) == after[0]


def test_the_digest_of_a_scene_depends_on_its_own_table_only(folder):
    before = digests(folder)
    touched(folder / TABLE)
    after = digests(folder)
    assert [b != a for b, a in zip(before, after, strict=True)] == [True, False]


def test_a_mesh_of_an_object_that_no_annotation_names_does_not_count(folder):
    before = digests(folder)
    (folder / "root/models/077").mkdir()
    (folder / "root/models/077/textured.obj").write_text("a mesh")
    assert digests(folder) == before


@pytest.mark.parametrize("file", [PARTS["meshes"], TABLE, PARTS["poses"]])
def test_missing_inputs_have_a_digest_too(folder, file):
    before = digests(folder)[0]
    (folder / file).unlink()
    assert digests(folder)[0] != before


def test_the_objects_of_the_toy_are_found(folder):
    assert annotated_ids(folder / "root/scenes/scene_0100/realsense/annotations") == sorted(
        toy_root.SHAPES
    )
