"""Stage synthesize with a user's meshes, and roots that are made in several runs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from pipelines import synthesize
from pipelines.configs import LabelConfig, SynthesizeConfig
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import read_grasp_label
from pipelines.errors import ValueRangeError
from pipelines.runtime.batch import BatchOptions, StageReport
from symgrasp_cli.app import app

QUIET = BatchOptions(progress=False)
OVER = replace(QUIET, overwrite=True)
DRY = replace(QUIET, dry_run=True)
CONFIG = SynthesizeConfig(
    splits=("train",),
    scenes_per_split=1,
    views=1,
    objects_per_pool=2,
    min_objects=1,
    max_objects=2,
    sensor="perfect",
    width=160,
    height=120,
    labels=LabelConfig(num_points=0),
)
LABELLED = replace(CONFIG, labels=LabelConfig(num_points=2))


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name, size in (("a", (0.05, 0.06, 0.1)), ("b", (0.04, 0.04, 0.12))):
        trimesh.creation.box(size).export(folder / f"{name}.ply")
    return folder


def make(root: Path, options: BatchOptions = QUIET, **more) -> StageReport:
    return synthesize.run(root, more.pop("config", CONFIG), options, **more)


def content(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_scenes_with_another_scale_of_the_objects_are_not_reused(meshes, tmp_path, monkeypatch):
    root = tmp_path / "root"
    make(root, models=meshes)
    assert make(root, models=meshes, mesh_scale=1.0).done == []  # the default scale, stated or not

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(synthesize, "write_scene", killed)
    with pytest.raises(KeyboardInterrupt):
        make(root, OVER, models=meshes, mesh_scale=0.5)
    monkeypatch.undo()
    report = make(root, models=meshes, mesh_scale=0.5)
    assert list(report.failed) == ["scene 0000"]
    assert "--overwrite" in report.failed["scene 0000"]
    assert make(root, OVER, models=meshes, mesh_scale=0.5).failed == {}
    assert make(root, models=meshes, mesh_scale=0.5).done == []


def test_a_run_killed_before_it_replaces_a_label_leaves_no_label_marked_as_finished(
    tmp_path, monkeypatch
):
    root = tmp_path / "root"
    make(root, config=LABELLED)

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(synthesize, "write_grasp_label", killed)
    wanted = replace(CONFIG, labels=LabelConfig(num_points=3))
    with pytest.raises(KeyboardInterrupt):
        make(root, OVER, config=wanted)
    monkeypatch.undo()
    make(root, config=wanted)
    assert len(read_grasp_label(root / "grasp_label" / "000_labels.npz").points) == 3


@pytest.mark.parametrize("inside", [".", "models", "models/000/nontextured.ply"])
def test_a_root_is_not_made_of_its_own_models(meshes, tmp_path, inside):
    root = tmp_path / "root"
    make(root, models=meshes, config=LABELLED)
    before = content(root)
    with pytest.raises(ValueRangeError, match="name another folder as OUT") as refused:
        make(root, OVER, models=root / inside)
    assert refused.value.exit_code == 2
    command = ["synthesize", str(root), "--models", str(root / inside), "--split", "train"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: --models is ")
    assert content(root) == before


def test_meshes_without_a_split_are_refused_with_all_splits_of_the_default(meshes, tmp_path):
    result = CliRunner().invoke(
        app, ["synthesize", str(tmp_path / "root"), "--models", str(meshes)]
    )
    assert result.exit_code == 2
    assert "--split is train,seen,similar,novel; it must be train, seen or both" in result.stderr


def test_the_list_of_objects_grows_with_the_splits(tmp_path):
    both, one_by_one = tmp_path / "both", tmp_path / "one"
    make(both, config=replace(CONFIG, splits=("train", "novel")))
    for split in ("train", "novel", "train"):
        make(one_by_one, config=replace(CONFIG, splits=(split,)))
    listed = object_list.read(one_by_one / "objects.json")
    assert [each.object_id for each in listed] == GraspNetRoot(one_by_one).object_ids()
    assert [each.pool for each in listed] == ["seen", "seen", "novel", "novel"]
    assert content(one_by_one) == content(both)


def test_objects_without_a_model_are_removed_from_the_list(meshes, tmp_path):
    root = tmp_path / "root"
    make(root, models=meshes)
    listed = json.loads((root / "objects.json").read_text())
    listed["objects"].append(listed["objects"][0] | {"object_id": 7})
    (root / "objects.json").write_text(json.dumps(listed))
    make(root, models=meshes)
    assert [o.object_id for o in object_list.read(root / "objects.json")] == [0, 1]


def test_meshes_too_small_or_flat_for_physics_are_named(meshes, tmp_path):
    triangle = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]], process=False)
    triangle.export(meshes / "c.ply")
    report = make(tmp_path / "root", models=meshes)
    assert list(report.failed) == ["object 002"]
    assert "c.ply: the 3 corners of a mesh span no volume" in report.failed["object 002"]
    (meshes / "c.ply").unlink()
    report = make(tmp_path / "small", models=meshes, mesh_scale=0.001)
    assert list(report.failed) == ["object 000", "object 001"]
    for words in ("a.ply", "0.127 mm", "--mesh-scale"):
        assert words in report.failed["object 000"]
    assert not (tmp_path / "small").exists() or not list((tmp_path / "small").rglob("*.ply"))


def test_pieces_without_volume_are_named_with_their_mesh(meshes, tmp_path, monkeypatch):
    sheet = trimesh.Trimesh(
        [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]]
    )
    sheet.export(meshes / "sheet.ply")
    module = "pipelines.geometry.meshes.convex_decomposition.decomposed"
    monkeypatch.setattr(module, lambda *_: [])  # the answer of coacd for some meshes
    report = make(tmp_path / "root", models=meshes / "sheet.ply")
    assert "sheet.ply: convex pieces of a model make no solid body" in report.failed["object 000"]


def test_a_dry_run_lists_all_outputs_and_writes_nothing(meshes, tmp_path):
    root = tmp_path / "root"
    names = ["object 000", "object 001", "label 000", "label 001"]
    names += ["distance grid 000", "distance grid 001", "scene 0000"]
    for models in (meshes, None):
        report = make(root, DRY, models=models, config=LABELLED, sdf=True)
        assert list(report.notes) == [*(() if models is None else ("objects",)), *names]
        assert report.notes["scene 0000"] == f"would write {root / 'scenes' / 'scene_0000'}"
        assert not root.exists()
    make(root, models=meshes)
    before = content(root)
    report = make(root, DRY, models=meshes, config=replace(LABELLED, scenes_per_split=2))
    assert report.skipped == ["object 000", "object 001"]
    assert list(report.notes) == ["objects", "label 000", "label 001", "scene 0001"]
    assert list(report.failed) == ["scene 0000"]  # labels are among a scene's settings
    assert content(root) == before


def test_meshes_with_a_distant_origin_are_visible_in_their_scenes(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    for number, offset in enumerate([(0.5, 0, 0), (0, 0.4, 0.1), (0.3, 0.3, 0)]):
        mesh = trimesh.creation.box((0.06, 0.08, 0.10))
        mesh.apply_translation(offset)
        mesh.export(folder / f"box{number}.ply")
    config = replace(CONFIG, min_objects=3, max_objects=3, views=2, scenes_per_split=2)
    make(tmp_path / "root", models=folder, config=config)
    root = GraspNetRoot(tmp_path / "root")
    offsets = []
    for scene in root.scenes():
        assert len(scene.object_ids) >= 2
        for frame in scene.frames():
            rows, columns = np.nonzero(root.read_label(frame))
            offsets.append((columns.mean() - 79.5, rows.mean() - 59.5))
    assert np.abs(offsets).max() < 35.0
    assert np.linalg.norm(np.mean(offsets, axis=0)) < 12.0
