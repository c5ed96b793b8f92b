"""label-grasps on meshes of all kinds, good and bad."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from pipelines import label_grasps
from pipelines.configs import LabelConfig, LabelGraspsConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import read_grasp_label
from pipelines.dataset.graspnet.signed_distance import read_sdf
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.object_list import read as read_object_list
from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.runtime.batch import BatchOptions, StageReport
from symgrasp_cli.app import app

QUIET = BatchOptions(progress=False)
CONFIG = LabelGraspsConfig(labels=LabelConfig(num_points=3))


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))


def box(size: float = 0.04) -> Mesh:
    return mesh_of(trimesh.creation.box((size, 1.5 * size, 2 * size)))


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    write_mesh(tmp_path / "in" / "box.ply", box())
    write_mesh(tmp_path / "in" / "rod.obj", mesh_of(trimesh.creation.cylinder(0.01, 0.1)))
    return tmp_path / "in"


def label(meshes: Path, out: Path, config: LabelGraspsConfig = CONFIG, **more) -> StageReport:
    more = {"options": QUIET, "sdf": False, **more}
    return label_grasps.run(meshes, out, config, **more)


def content(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def test_a_folder_of_meshes_becomes_a_dataset_root(meshes: Path, tmp_path: Path) -> None:
    report = label(meshes, tmp_path / "out", sdf=True)
    assert report.done == ["000 box", "001 rod"]
    assert not report.failed
    root = GraspNetRoot(tmp_path / "out")
    assert root.object_ids() == [0, 1]
    for i in (0, 1):
        folder = root.model_path(i).parent
        names = {"nontextured.ply", "textured.obj", "textured.sdf"}
        assert names <= {path.name for path in folder.iterdir()}
        assert read_sdf(folder / "textured.sdf").values.shape == (100, 100, 100)
        made = read_grasp_label(root.grasp_label_path(i))
        assert len(made.points) == 3
        assert (made.min_friction > 0).any()
    records = read_object_list(tmp_path / "out" / "objects.json")
    assert [(r.object_id, r.name, r.details["file"]) for r in records] == [
        (0, "box", "box.ply"),
        (1, "rod", "rod.obj"),
    ]


def test_the_originals_loader_reads_the_arrays(meshes: Path, tmp_path: Path) -> None:
    # graspnetAPI's loadGraspLabels: np.load, three arrays by name, to float32.
    label(meshes / "box.ply", tmp_path / "out")
    path = tmp_path / "out" / "grasp_label" / f"{str(0).zfill(3)}_labels.npz"
    file = np.load(path)
    points, offsets, scores = (
        file[name].astype(np.float32) for name in ("points", "offsets", "scores")
    )
    collision = file["collision"]
    assert (points.shape, offsets.shape) == ((3, 3), (3, 300, 12, 4, 3))
    assert scores.shape == collision.shape == (3, 300, 12, 4)
    assert collision.dtype == np.bool_
    assert {file[name].dtype for name in ("points", "offsets", "scores")} == {np.dtype("f4")}
    # loadGrasp's mask, and the columns that it makes of the remaining grasps.
    mask = (scores <= 0.4) & (scores > 0) & ~collision
    assert mask.any()
    angle, depth, width = offsets[mask].T
    assert ((angle >= 0) & (angle < np.pi)).all()
    assert set(np.round(depth * 100).astype(int)) <= {1, 2, 3, 4}
    assert ((width > 0) & (width <= np.float32(0.12))).all()


def test_a_second_run_skips_and_other_settings_are_refused(meshes: Path, tmp_path: Path) -> None:
    label(meshes, tmp_path / "out")
    before = content(tmp_path / "out")
    again = label(meshes, tmp_path / "out")
    assert again.skipped == ["000 box", "001 rod"]
    assert content(tmp_path / "out") == before
    other = LabelGraspsConfig(labels=LabelConfig(num_points=4))
    refused = label(meshes, tmp_path / "out", other)
    assert refused.exit_code == 1
    assert "--overwrite" in refused.failed["000 box"]
    assert content(tmp_path / "out") == before


@pytest.mark.parametrize("name", ["nontextured.ply", "textured.obj"])
def test_a_lost_model_is_made_again(meshes: Path, tmp_path: Path, name: str) -> None:
    label(meshes, tmp_path / "out")
    before = content(tmp_path / "out")
    (tmp_path / "out" / "models" / "001" / name).unlink()
    assert label(meshes, tmp_path / "out").failed == {}
    assert content(tmp_path / "out") == before


def test_workers_and_a_kill_in_the_middle_change_no_byte(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(label_grasps, "POINTS_A_PART", 1)
    label(meshes, tmp_path / "one")
    two = BatchOptions(progress=False, workers=2, backend="threading")
    label(meshes, tmp_path / "two", options=two)
    written = []

    def killed(*arguments: object, **named: object) -> None:
        written.append(arguments)
        if len(written) == 2:
            raise KeyboardInterrupt
        write(*arguments, **named)

    write = label_grasps.write_grasp_label
    monkeypatch.setattr(label_grasps, "write_grasp_label", killed)
    with pytest.raises(KeyboardInterrupt):
        label(meshes, tmp_path / "cut")
    assert not list((tmp_path / "cut" / "grasp_label").glob("*.npz"))
    label(meshes, tmp_path / "cut")
    assert len(written) == 2 + 5  # the first part is not made again
    assert content(tmp_path / "two") == content(tmp_path / "one")
    assert content(tmp_path / "cut") == content(tmp_path / "one")


def test_parts_of_other_settings_are_not_joined(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(label_grasps, "join_grasp_labels", killed)
        with pytest.raises(KeyboardInterrupt):
            label(meshes / "box.ply", tmp_path / "out", seed=1)
    label(meshes / "box.ply", tmp_path / "out", seed=2)
    assert "removed 1 part of an earlier run" in caplog.text
    label(meshes / "box.ply", tmp_path / "fresh", seed=2)
    assert content(tmp_path / "out") == content(tmp_path / "fresh")


def test_parts_in_a_linked_folder_are_removed_and_the_link_stays(
    meshes: Path, tmp_path: Path
) -> None:
    far, link = tmp_path / "far", tmp_path / "out" / "grasp_label" / "000_labels.parts"
    for folder in (far, link.parent):
        folder.mkdir(parents=True)
    (far / "own.txt").touch()
    link.symlink_to(far)
    assert label(meshes / "box.ply", tmp_path / "out").done == ["000 box"]
    assert link.is_symlink()
    assert [path.name for path in far.iterdir()] == ["own.txt"]


def test_compressed_labels_hold_the_same_in_fewer_bytes(meshes: Path, tmp_path: Path) -> None:
    label(meshes / "box.ply", tmp_path / "plain")
    label(meshes / "box.ply", tmp_path / "zipped", compress=True)
    paths = [GraspNetRoot(tmp_path / name).grasp_label_path(0) for name in ("plain", "zipped")]
    plain, zipped = (read_grasp_label(path) for path in paths)
    np.testing.assert_array_equal(plain.offsets, zipped.offsets)
    np.testing.assert_array_equal(plain.collision, zipped.collision)
    assert paths[1].stat().st_size < 0.2 * paths[0].stat().st_size
    label(meshes / "box.ply", tmp_path / "plain", compress=True, options=BatchOptions(dry_run=True))
    assert paths[0].stat().st_size > paths[1].stat().st_size
    report = label(meshes / "box.ply", tmp_path / "plain", compress=True)
    assert report.done == ["000 box"]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    for compress in (True, False):  # compressed labels stay
        assert label(meshes / "box.ply", tmp_path / "plain", compress=compress).skipped
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_bad_meshes_are_named_and_the_rest_is_done(meshes: Path, tmp_path: Path) -> None:
    (meshes / "empty.ply").write_bytes(b"")
    (meshes / "nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    write_mesh(meshes / "large.ply", box(40.0))
    twice = box()
    write_mesh(meshes / "twice.ply", Mesh(twice.vertices, np.tile(twice.faces, (2, 1))))
    report = label(meshes, tmp_path / "out")
    assert report.exit_code == 1
    assert sorted(report.failed) == ["001 empty", "002 large", "003 nan"]
    assert all("\n" not in sentence for sentence in report.failed.values())
    assert "NaN" in report.failed["003 nan"]
    for word in ("107.7 m", "--mesh-scale 0.001", "and 1 states"):
        assert word in report.failed["002 large"]
    assert report.done == ["000 box", "004 rod", "005 twice"]
    assert "dropped 12 duplicate triangles" in report.notes["005 twice"]
    names = [r.name for r in read_object_list(tmp_path / "out" / "objects.json")]
    assert names == ["box", "rod", "twice"]


def test_millimetres_are_scaled_and_give_the_label_of_metres(tmp_path: Path) -> None:
    write_mesh(tmp_path / "metres" / "box.ply", box(0.04))
    write_mesh(tmp_path / "mm" / "box.ply", box(40.0))
    label(tmp_path / "metres", tmp_path / "a")
    label(tmp_path / "mm", tmp_path / "b", mesh_scale=0.001)
    one, other = (
        read_grasp_label(GraspNetRoot(tmp_path / name).grasp_label_path(0)) for name in "ab"
    )
    np.testing.assert_allclose(one.points, other.points, atol=1e-7)
    assert (one.min_friction == other.min_friction).mean() > 0.9999


def test_a_mesh_turned_inside_out_is_turned_back(tmp_path: Path) -> None:
    good = box()
    write_mesh(tmp_path / "in" / "box.ply", Mesh(good.vertices, good.faces[:, ::-1]))
    report = label(tmp_path / "in", tmp_path / "out")
    assert "inward" in report.notes["000 box"]
    assert read_mesh(GraspNetRoot(tmp_path / "out").model_path(0)).volume > 0


@pytest.mark.parametrize("which", ["all", "some"])
def test_an_open_mesh_with_inward_normals_gets_the_same_labels_as_one_without(
    which: str, tmp_path: Path
) -> None:
    good = box()
    faces = good.faces[:-1]  # open
    turned = np.arange(len(faces)) % 3 == 0 if which == "some" else np.ones(len(faces), np.bool_)
    bad = np.where(turned[:, None], faces[:, ::-1], faces)
    write_mesh(tmp_path / "good" / "box.ply", Mesh(good.vertices, faces))
    write_mesh(tmp_path / "bad" / "box.ply", Mesh(good.vertices, bad))
    notes = [label(tmp_path / n, tmp_path / f"{n}_out").notes["000 box"] for n in ("good", "bad")]
    assert notes[1].startswith(notes[0])
    assert "which looked inward" in notes[1]
    one, other = (
        read_grasp_label(GraspNetRoot(tmp_path / f"{n}_out").grasp_label_path(0))
        for n in ("good", "bad")
    )
    assert (one.min_friction > 0).any()
    assert np.mean(one.min_friction > 0) == pytest.approx(np.mean(other.min_friction > 0), rel=0.05)


def test_a_root_labelled_in_place_has_labels_of_meshes_with_inward_normals(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    good, root = box(), tmp_path / "root"
    model = GraspNetRoot(root).model_path(0)
    write_mesh(model, Mesh(good.vertices, good.faces[:, ::-1]))
    before = model.read_bytes()
    label(root, root)
    assert (read_grasp_label(GraspNetRoot(root).grasp_label_path(0)).min_friction > 0).any()
    assert caplog.text.count("turned its triangles, which looked inward") == 1
    assert model.read_bytes() == before


def test_more_meshes_get_the_next_numbers(meshes: Path, tmp_path: Path) -> None:
    label(meshes, tmp_path / "out")
    write_mesh(meshes / "apple.ply", box(0.03))
    report = label(meshes, tmp_path / "out")
    assert report.done == ["002 apple"]
    assert sorted(report.skipped) == ["000 box", "001 rod"]


def test_a_repaired_mesh_gets_the_number_reserved_for_it(meshes: Path, tmp_path: Path) -> None:
    (meshes / "lid.ply").write_bytes(b"")
    assert label(meshes, tmp_path / "out").done == ["000 box", "002 rod"]
    write_mesh(meshes / "lid.ply", box(0.03))
    assert label(meshes, tmp_path / "out").done == ["001 lid"]


def test_the_command_names_failed_meshes_and_exits_with_1(meshes: Path, tmp_path: Path) -> None:
    (meshes / "lid.ply").write_bytes(b"")
    arguments = ["label-grasps", str(meshes), "--out", str(tmp_path / "out"), "--points", "1"]
    result = CliRunner().invoke(app, [*arguments, "--no-sdf"])
    assert result.exit_code == 1
    assert "error: 001 lid" in result.output
    assert "2 done, 0 skipped as finished, 1 failed" in result.output


def test_a_root_is_labelled_in_place_or_into_another(meshes: Path, tmp_path: Path) -> None:
    for object_id in (3, 7):
        write_mesh(GraspNetRoot(tmp_path / "root").model_path(object_id), box())
    label(tmp_path / "root", tmp_path / "other")
    assert GraspNetRoot(tmp_path / "other").object_ids() == [3, 7]
    report = label(tmp_path / "root", tmp_path / "root")
    assert report.done == ["003", "007"]
    here, there = (
        GraspNetRoot(tmp_path / name).grasp_label_path(7).read_bytes() for name in ("root", "other")
    )
    assert here == there
    assert not (tmp_path / "root" / "models" / "003" / "provenance.json").exists()


def test_a_root_labelled_in_place_is_refused_if_its_models_are_millimetres(tmp_path: Path) -> None:
    root, mesh = tmp_path / "root", box(0.4)
    write_mesh(GraspNetRoot(root).model_path(3), Mesh(10.0 * mesh.vertices, mesh.faces))
    assert "looks like millimetres" in label(root, root).failed["003"]
    with pytest.raises(SymgraspError, match="1 or left out for a root"):
        label(root, root, mesh_scale=0.001)
    assert label(root, root, mesh_scale=1.0).done == ["003"]


def test_a_file_in_place_of_the_root_is_named(meshes: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SymgraspError, match="file is a file; name a folder"):
        label(meshes, tmp_path / "file")


def test_a_dry_run_writes_nothing(meshes: Path, tmp_path: Path) -> None:
    report = label(meshes, tmp_path / "out", options=BatchOptions(dry_run=True, progress=False))
    assert "000_labels.npz" in report.notes["000 box"]
    assert not (tmp_path / "out").exists()
    label(meshes / "box.ply", tmp_path / "out")
    before = content(tmp_path / "out")
    again = label(meshes, tmp_path / "out", options=BatchOptions(dry_run=True, progress=False))
    assert again.skipped == ["000 box"]
    assert "001_labels.npz" in again.notes["001 rod"]
    assert content(tmp_path / "out") == before


def test_a_kill_before_a_label_is_replaced_leaves_no_label_with_another_stamp(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    over = BatchOptions(progress=False, overwrite=True)
    other = LabelGraspsConfig(labels=LabelConfig(num_points=2))
    path = GraspNetRoot(tmp_path / "out").grasp_label_path(0)
    grid = tmp_path / "out" / "models" / "000" / "textured.sdf"
    for function, target in (("write_sdf", grid), ("join_grasp_labels", path)):
        label(meshes / "box.ply", tmp_path / "out", options=over, sdf=target == grid)
        assert target.exists()
        with monkeypatch.context() as patch:
            patch.setattr(label_grasps, function, killed)
            with pytest.raises(KeyboardInterrupt):
                label(meshes / "box.ply", tmp_path / "out", other, options=over, sdf=target == grid)
        assert not target.exists()
    assert label(meshes / "box.ply", tmp_path / "out", other).done == ["000 box"]
    assert len(read_grasp_label(path).points) == 2


def test_a_mesh_too_small_to_be_held_gives_a_note(meshes: Path, tmp_path: Path) -> None:
    report = label(meshes / "box.ply", tmp_path / "out", mesh_scale=0.001)
    assert "0.108 mm" in report.notes["000 box"]
    assert "--mesh-scale" in report.notes["000 box"]
    label(meshes / "box.ply", tmp_path / "right")
    again = label(tmp_path / "right", tmp_path / "right")
    assert "--mesh-scale" not in again.notes.get("000", "")


def test_collision_labels_of_earlier_labels_give_a_note(tmp_path: Path) -> None:
    root = GraspNetRoot(tmp_path / "root")
    for object_id in (0, 1):
        write_mesh(root.model_path(object_id), box())
    for scene_id, ids in ((0, "0\n"), (1, "1\n"), (2, "0\n1\n")):
        (root.scene_folder(scene_id) / "kinect").mkdir(parents=True)
        (root.scene_folder(scene_id) / "object_id_list.txt").write_text(ids)
        root.collision_label_path(scene_id).parent.mkdir(parents=True)
    assert "collision labels" not in label(root.root, root.root).notes
    for scene_id in (1, 2):
        root.collision_label_path(scene_id).write_bytes(b"of other labels")
    assert "collision labels" not in label(root.root, root.root).notes  # all are finished
    root.grasp_label_path(0).unlink()
    note = label(root.root, root.root).notes["collision labels"]
    assert "of 1 scene (first scene_0002)" in note
    over = BatchOptions(progress=False, overwrite=True)
    note = label(root.root, root.root, options=over).notes["collision labels"]
    assert "of 2 scenes (first scene_0001) belong to the earlier grasp labels" in note


def test_the_number_of_points_follows_the_area_within_bounds() -> None:
    assert label_grasps.number_of_points(box(), CONFIG) == 3
    config = LabelGraspsConfig()
    assert label_grasps.number_of_points(box(), config) == round(box().area / 32e-6)
    assert label_grasps.number_of_points(box(0.001), config) == 64
    assert label_grasps.number_of_points(box(1.0), config) == 3500


def test_a_folder_without_meshes_is_reported_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SymgraspError, match="does not exist"):
        label(tmp_path / "none", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SymgraspError, match="holds no meshes"):
        label(tmp_path / "empty", tmp_path / "out")


def test_the_list_of_objects_does_not_depend_on_the_run(meshes: Path, tmp_path: Path) -> None:
    label(meshes / "box.ply", tmp_path / "out")
    label(meshes / "rod.obj", tmp_path / "out")
    listed = json.loads((tmp_path / "out" / "objects.json").read_text())
    assert [entry["name"] for entry in listed["objects"]] == ["box", "rod"]
