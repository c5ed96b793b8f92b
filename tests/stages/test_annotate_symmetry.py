"""The annotate-symmetry stage: files in, files out."""

import json

import numpy as np
import pytest
import trimesh

from pipelines import annotate_symmetry
from pipelines.batch import BatchOptions
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.errors import SymgraspError
from pipelines.formats import symmetry_labels
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.meshes import write_mesh
from tests.stages.dataset_root import shapes

QUICK = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)
QUIET = BatchOptions(progress=False)


def write_meshes(folder):
    for name, mesh in zip(("box", "can", "pair"), shapes(), strict=True):
        write_mesh(folder / f"{name}.ply", mesh)
    return folder


def run(source, out=None, options=QUIET):
    return annotate_symmetry.run(source, out, QUICK, options=options)


def test_a_folder_of_meshes_becomes_a_folder_of_json(tmp_path):
    report = run(write_meshes(tmp_path / "meshes"), tmp_path / "out")
    assert report.done == ["box", "can", "pair"]
    can = symmetry_labels.read(tmp_path / "out" / "can.json")
    assert [symmetry.kind for symmetry in can.symmetries] == ["reflection", "rotation"]
    pair = symmetry_labels.read(tmp_path / "out" / "pair.json")
    assert len(pair.regions) == 2
    assert not pair.symmetries


def test_the_file_says_what_the_symmetries_are_and_how_it_was_made(tmp_path):
    mesh = write_meshes(tmp_path / "meshes") / "can.ply"
    run(mesh, tmp_path / "out")
    content = json.loads((tmp_path / "out" / "can.json").read_text())
    assert {"object", "symmetries", "regions", "provenance"} <= set(content)
    axis = next(entry for entry in content["symmetries"] if entry["kind"] == "rotation")
    assert axis["order"] is None
    assert abs(axis["axis"][2]) > 0.9999


def test_a_second_run_skips_what_is_finished(tmp_path):
    mesh = write_meshes(tmp_path / "meshes") / "box.ply"
    run(mesh, tmp_path / "out")
    assert run(mesh, tmp_path / "out").skipped == ["box"]


def test_a_dataset_root_gets_its_symmetry_folder_and_regions_by_hand_win(tmp_path):
    root = GraspNetRoot(tmp_path)
    write_mesh(root.model_path(0), shapes()[0])
    root.region_path(0).parent.mkdir()
    given = {"regions": [{"name": "half", "box": [[0.0, -1, -1], [1, 1, 1]]}]}
    root.region_path(0).write_text(json.dumps(given))
    assert run(tmp_path).done == ["000"]
    labels = symmetry_labels.read(root.symmetry_path(0))
    assert [region.name for region in labels.regions] == ["half"]
    assert len(labels.symmetries) == 4  # three planes and the half turn about the longest side


def test_changed_regions_make_the_annotation_stale(tmp_path):
    root = GraspNetRoot(tmp_path)
    write_mesh(root.model_path(0), shapes()[0])
    run(tmp_path)
    root.region_path(0).parent.mkdir()
    root.region_path(0).write_text('{"regions": [{"name": "all", "triangles": [0, 1, 2]}]}')
    assert "--overwrite" in run(tmp_path).failed["000"]


def test_a_damaged_mesh_fails_alone(tmp_path):
    folder = write_meshes(tmp_path / "meshes")
    (folder / "damaged.ply").write_text("ply\nformat ascii 1.0\nelement")
    report = run(folder, tmp_path / "out")
    assert len(report.done) == 3
    assert "damaged.ply" in report.failed["damaged"]


def test_loose_meshes_need_a_folder_to_write_to(tmp_path):
    with pytest.raises(SymgraspError, match="--out"):
        run(write_meshes(tmp_path))


def test_a_folder_without_meshes_is_one_sentence(tmp_path):
    with pytest.raises(SymgraspError, match="no meshes"):
        run(tmp_path, tmp_path / "out")


def test_the_note_counts_symmetries_and_names_regions():
    mesh, rng = shapes()[2], np.random.default_rng(0)
    labels = annotate_symmetry.annotate(mesh, "pair", QUICK, rng)
    assert {region.name for region in labels.regions} == {"body0", "part0"}
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    triangles = np.concatenate([region.triangles for region in labels.regions])
    assert len(triangles) == len(whole.faces)
