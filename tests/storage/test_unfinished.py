"""Unfinished folders of a stopped command, which every later command refuses."""

from pathlib import Path

import pytest

from pipelines import label_grasps, synthesize
from pipelines.configs import LabelGraspsConfig, SynthesizeConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError
from pipelines.frames.frames import find_frames
from pipelines.runtime.batch import BatchOptions, StageReport
from pipelines.storage.unfinished import mark_finished, mark_unfinished, refuse_unfinished
from tests.frames.layouts import build

QUIET = BatchOptions(progress=False)


def test_an_unfinished_root_is_refused_until_its_command_ends(tmp_path: Path) -> None:
    build.graspnet_scene(tmp_path / "scenes/scene_0000/kinect")
    mark_unfinished(tmp_path, "synthesize")
    for read in (GraspNetRoot.finished, find_frames, refuse_unfinished):
        with pytest.raises(SymgraspError, match=r"`symgrasp synthesize`.*run the same command"):
            read(tmp_path)
    mark_finished(tmp_path, "label-grasps")  # the end of another command
    with pytest.raises(SymgraspError, match="unfinished"):
        refuse_unfinished(tmp_path)
    mark_finished(tmp_path, "synthesize")
    assert GraspNetRoot.finished(tmp_path).scene_ids() == [0]
    assert len(find_frames(tmp_path)) == build.COUNT


def test_a_stopped_or_failed_synthesize_leaves_the_mark_of_an_unfinished_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_arguments: object) -> StageReport:
        raise KeyboardInterrupt

    monkeypatch.setattr(synthesize._PlannedRoot, "write_object_list", lambda _root: None)
    monkeypatch.setattr(synthesize, "run_batch", stopped)
    with pytest.raises(KeyboardInterrupt):
        synthesize.run(tmp_path, SynthesizeConfig(), QUIET)
    with pytest.raises(SymgraspError, match="unfinished"):
        refuse_unfinished(tmp_path)
    failed = {"scene 0000": "no room"}
    monkeypatch.setattr(synthesize, "run_batch", lambda *_: StageReport("part", failed=failed))
    synthesize.run(tmp_path, SynthesizeConfig(), QUIET)
    with pytest.raises(SymgraspError, match="unfinished"):
        refuse_unfinished(tmp_path)
    monkeypatch.setattr(synthesize, "run_batch", lambda *_: StageReport("part"))
    synthesize.run(tmp_path, SynthesizeConfig(), QUIET)
    refuse_unfinished(tmp_path)


def test_meshes_of_an_unfinished_root_are_not_labelled(tmp_path: Path) -> None:
    (tmp_path / "source/models").mkdir(parents=True)
    mark_unfinished(tmp_path / "source", "synthesize")
    with pytest.raises(SymgraspError, match="unfinished"):
        label_grasps.run(tmp_path / "source", tmp_path / "out", LabelGraspsConfig())
