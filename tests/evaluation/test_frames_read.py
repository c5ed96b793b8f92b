"""Refusal of a dataset whose frames are others than those that `infer` read."""

import shutil
from pathlib import Path

import pytest

from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.errors import FormatError
from pipelines.evaluation.runs.other_runs import ComparedRuns
from pipelines.runtime.batch import BatchOptions
from tests.stages.toy_root import write_root

OPTIONS = BatchOptions(progress=False, overwrite=True)
BELOW = "scenes/scene_0160/realsense"


def grasps_of(root: Path, output: Path, below: str = "") -> Path:
    config = InferConfig(regions="geometric", method="random")
    infer.run(infer.InferPaths(root / below, output), config, OPTIONS)
    return output


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset, its grasps, and another dataset with scenes of the same numbers."""
    folder = tmp_path_factory.mktemp("made")
    root = write_root(folder / "first").root
    for below, name in (("", "all.h5"), (BELOW, "scene.h5")):
        grasps_of(root, folder / name, below)
    make_other(Path(shutil.copytree(root, folder / "second")))
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


def make_other(root: Path) -> None:
    """Change poses and depth of all frames of a dataset."""
    for kind in ("annotations", "depth", "meta"):
        for path in root.glob(f"scenes/*/*/{kind}/*"):
            path.write_bytes(path.read_bytes() + b" ")


def check(grasps: Path, root: Path) -> dict[str, str]:
    return ComparedRuns.of(grasps, (), root).frames_notes()


@pytest.mark.parametrize("name", ["all.h5", "scene.h5"])
def test_a_dataset_made_again_in_place_is_refused(folder, name):
    assert check(folder / name, folder / "first") == {}
    make_other(folder / "first")
    with pytest.raises(FormatError, match=r"first have changed since infer read them; run infer"):
        check(folder / name, folder / "first")


@pytest.mark.parametrize("name", ["all.h5", "scene.h5"])
def test_grasps_moved_beside_another_dataset_of_the_same_name_keep_their_own(folder, name):
    (folder / "beside").mkdir()
    (folder / "second").rename(folder / "beside" / "first")
    moved = Path(shutil.move(folder / name, folder / "beside" / name))
    assert check(moved, folder / "first") == {}
    with pytest.raises(FormatError, match="have changed since infer read them"):
        check(moved, folder / "beside" / "first")


def test_another_dataset_is_noted_once_the_dataset_of_the_grasps_is_gone(folder):
    with pytest.raises(FormatError, match=r"was read from .*first, and is another in .*second"):
        check(folder / "all.h5", folder / "second")
    (folder / "first").rename(folder / "renamed")
    assert check(folder / "all.h5", folder / "renamed") == {}
    (note,) = check(folder / "all.h5", folder / "second").values()
    assert "is gone, and" in note
