"""The annotate-symmetry stage, from meshes to annotation files."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from pipelines import annotate_symmetry
from pipelines.annotation import jobs
from pipelines.annotation.extras import AnnotationExtras
from pipelines.annotation.objects import annotate
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import write_mesh
from pipelines.dataset.symmetry import bop_models_info, symmetry_labels
from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.runtime.batch import BatchOptions
from pipelines.runtime.one_run import OutputInUseError, output_locked
from pipelines.storage.images import read_image
from pipelines.storage.provenance import sidecar_of
from tests.stages.dataset_root import shapes, write_root

QUICK = AnnotateSymmetryConfig(
    num_samples=6000,
    num_verification_samples=800,
    grid_resolution=40,
    plane_directions=400,
    axis_directions=250,
)
QUIET = BatchOptions(progress=False)


def write_meshes(folder):
    for name, mesh in zip(("box", "can", "pair"), shapes(), strict=True):
        write_mesh(folder / f"{name}.ply", mesh)
    return folder


def run(source, out=None, options=QUIET):
    return annotate_symmetry.run(source, out, QUICK, options=options)


def test_a_folder_of_meshes_gives_a_folder_of_json(tmp_path):
    report = run(write_meshes(tmp_path / "meshes"), tmp_path / "out")
    assert report.done == ["box", "can", "pair"]
    can = symmetry_labels.read(tmp_path / "out" / "can.json")
    assert [symmetry.kind for symmetry in can.symmetries] == ["reflection", "rotation"]
    pair = symmetry_labels.read(tmp_path / "out" / "pair.json")
    assert len(pair.regions) == 2
    assert not pair.symmetries


def test_uncut_objects_have_one_region_if_they_are_symmetric_and_none_if_not(tmp_path):
    meshes, uncut = write_meshes(tmp_path / "meshes"), replace(QUICK, cut_objects=False)
    report = annotate_symmetry.run(meshes, tmp_path / "out", uncut, options=QUIET)
    assert report.notes["pair"] == "no symmetry; regions: none"
    for name, count in (("box", 1), ("can", 1), ("pair", 0)):
        labels = symmetry_labels.read(tmp_path / "out" / f"{name}.json")
        kinds = [symmetry.kind for symmetry in labels.symmetries]
        found = [[each.kind for each in region.symmetries] for region in labels.regions]
        assert found == [kinds] * count


def test_the_file_holds_the_symmetries_and_how_it_was_made(tmp_path):
    mesh = write_meshes(tmp_path / "meshes") / "can.ply"
    run(mesh, tmp_path / "out")
    content = json.loads((tmp_path / "out" / "can.json").read_text())
    assert {"object", "symmetries", "regions", "provenance"} <= set(content)
    axis = next(entry for entry in content["symmetries"] if entry["kind"] == "rotation")
    assert axis["order"] is None
    assert abs(axis["axis"][2]) > 0.9999


def test_a_dataset_and_loose_meshes_into_its_symmetries_exclude_each_other(tmp_path):
    root = write_root(tmp_path / "root").root
    out, mesh = root / "symmetry", root / "models/000/nontextured.ply"
    for held, started in ((out, (root,)), (out, (mesh, out))):
        with output_locked(held, jobs.STAGE), pytest.raises(OutputInUseError):
            run(*started)
    assert not list(out.glob("*.json"))


def test_a_dataset_root_gets_a_symmetry_folder_and_regions_by_hand_take_precedence(tmp_path):
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


def test_loose_meshes_need_a_folder_to_write_to(tmp_path):
    with pytest.raises(SymgraspError, match="--out"):
        run(write_meshes(tmp_path))


def test_a_folder_without_meshes_is_reported_in_one_sentence(tmp_path):
    with pytest.raises(SymgraspError, match="no meshes"):
        run(tmp_path, tmp_path / "out")


def test_two_meshes_of_one_name_fail_with_a_sentence_each_and_the_rest_is_done(tmp_path):
    box, can, _ = shapes()
    for name, mesh in (("box.ply", box), ("box.obj", box), ("can.ply", can)):
        write_mesh(tmp_path / "meshes" / name, mesh)
    report = run(tmp_path / "meshes", tmp_path / "out")
    assert report.done == ["can"]
    assert set(report.failed) == {"box.obj", "box.ply"}
    assert "rename one" in report.failed["box.obj"]


BAD = {
    "damaged.ply": b"ply\nformat ascii 1.0\nelement",
    "empty.ply": b"",
    "points.ply": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
    b"property float y\nproperty float z\nend_header\n0 0 0\n",
    "nan.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "flat.obj": b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    "noise.stl": b"\x00\x01\x02" * 50,
}


def test_bad_meshes_give_one_sentence_each_and_the_rest_is_done(tmp_path):
    folder = tmp_path / "meshes"
    write_mesh(folder / "can.ply", shapes()[1])
    for name, content in BAD.items():
        (folder / name).write_bytes(content)
    report = run(folder, tmp_path / "out")
    assert report.done == ["can"]
    assert set(report.failed) == {name.split(".")[0] for name in BAD}
    assert report.exit_code == 1
    assert "damaged.ply" in report.failed["damaged"]
    assert not any("\n" in sentence for sentence in report.failed.values())


def test_degenerate_and_repeated_triangles_change_only_the_note(tmp_path):
    can = shapes()[1]
    spoilt = Mesh(can.vertices, np.concatenate([can.faces, can.faces[:9], [[0, 0, 1], [5, 5, 5]]]))
    write_mesh(tmp_path / "can.ply", spoilt)
    report = run(tmp_path / "can.ply", tmp_path / "out")
    assert "2 degenerate triangles and 9 duplicate triangles" in report.notes["can"]
    labels = symmetry_labels.read(tmp_path / "out" / "can.json")
    assert [symmetry.kind for symmetry in labels.symmetries] == ["reflection", "rotation"]
    assert len(labels.regions[0].triangles) == len(spoilt.faces)


def test_regions_hold_the_repetitions_of_their_triangles(tmp_path):
    pair = shapes()[2]
    write_mesh(tmp_path / "pair.ply", Mesh(pair.vertices, np.concatenate([pair.faces] * 2)))
    run(tmp_path / "pair.ply", tmp_path / "out")
    regions = symmetry_labels.read(tmp_path / "out" / "pair.json").regions
    triangles = np.concatenate([region.triangles for region in regions])
    assert len(triangles) == len(np.unique(triangles)) == 2 * len(pair.faces)


def test_the_refusal_of_centimetres_names_their_scale(tmp_path):
    can = shapes()[1]
    write_mesh(tmp_path / "can.ply", Mesh(100.0 * can.vertices, can.faces))
    sentence = run(tmp_path / "can.ply", tmp_path / "out").failed["can"]
    assert f"0.01 (centimetres) {can.diagonal:.4g} m" in sentence


def test_millimetres_are_refused_unless_stated_and_give_symmetries_in_metres(tmp_path):
    can = shapes()[1]
    write_mesh(tmp_path / "can.ply", Mesh(1000.0 * can.vertices + 500.0, can.faces))
    refused = run(tmp_path / "can.ply", tmp_path / "out")
    assert "looks like millimetres" in refused.failed["can"]
    assert not (tmp_path / "out" / "can.json").exists()
    extras = AnnotationExtras(pictures=tmp_path / "sheets", bop=tmp_path / "models_info.json")
    report = annotate_symmetry.run(
        tmp_path / "can.ply", tmp_path / "out", QUICK,
        extras=extras, mesh_scale=0.001, options=QUIET,
    )  # fmt: skip
    assert report.done == ["can"]
    assert not report.failed
    for symmetry in symmetry_labels.read(tmp_path / "out" / "can.json").symmetries:
        np.testing.assert_allclose(symmetry.point, 0.5, atol=0.2)
    entry = next(iter(json.loads((tmp_path / "models_info.json").read_text()).values()))
    assert 100.0 < entry["diameter"] < 400.0  # millimetres


def test_a_root_whose_models_are_millimetres_is_refused_unless_they_are_stated_as_metres(tmp_path):
    can = shapes()[1]
    write_mesh(tmp_path / "models/000/nontextured.ply", Mesh(1000.0 * can.vertices, can.faces))
    assert "looks like millimetres" in run(tmp_path).failed["000"]
    assert annotate_symmetry.run(tmp_path, None, QUICK, mesh_scale=1.0, options=QUIET).done
    with pytest.raises(SymgraspError, match="whose meshes every stage takes as metres"):
        annotate_symmetry.run(tmp_path, None, QUICK, mesh_scale=0.001, options=QUIET)


def test_a_dataset_has_no_other_folder_for_its_symmetries(tmp_path):
    write_mesh(tmp_path / "root/models/000/nontextured.ply", shapes()[1])
    with pytest.raises(SymgraspError, match=r"are written to .*root/symmetry; leave --out out"):
        run(tmp_path / "root", tmp_path / "out")


def test_files_in_place_of_output_folders_are_named_before_any_work(tmp_path):
    write_mesh(tmp_path / "can.ply", shapes()[1])
    (tmp_path / "file").touch()
    with pytest.raises(SymgraspError, match="file is a file; name a folder"):
        run(tmp_path / "can.ply", tmp_path / "file")
    with pytest.raises(SymgraspError, match="file is a file; name a folder"):
        annotate_symmetry.run(
            tmp_path / "can.ply", tmp_path / "out", QUICK,
            extras=AnnotationExtras(pictures=tmp_path / "file"), options=QUIET,
        )  # fmt: skip


def corrected(tmp_path, entries, options=QUIET, name="box"):
    path = tmp_path / "edits.json"
    path.write_text(json.dumps({name: entries}))
    extras = AnnotationExtras(edits=path)
    return annotate_symmetry.run(
        tmp_path / "box.ply", tmp_path / "out", QUICK, extras=extras, options=options
    )


@pytest.fixture(scope="module")
def finished_box(tmp_path_factory):
    folder = tmp_path_factory.mktemp("box")
    write_mesh(folder / "box.ply", shapes()[0])
    run(folder / "box.ply", folder / "out")
    return folder


@pytest.fixture
def box(finished_box, tmp_path):
    """A folder with `box.ply` and its annotation."""
    shutil.copytree(finished_box, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_second_run_skips_what_is_finished(box):
    assert run(box / "box.ply", box / "out").skipped == ["box"]


DROP = {"drop": {"kind": "reflection", "index": 1}}


def labels_of(folder):
    return symmetry_labels.read(folder / "out" / "box.json")


def test_a_correction_changes_the_finished_annotation_and_is_recorded(box):
    before = labels_of(box)
    assert corrected(box, [DROP]).done == ["box"]
    after = labels_of(box)
    assert len(after.symmetries) == len(before.symmetries) - 1
    assert [s.point.tolist() for s in after.found] == [s.point.tolist() for s in before.symmetries]
    assert after.doubt == 0.0
    assert [len(region.symmetries) for region in after.regions] == [len(after.symmetries)]
    content = json.loads((box / "out" / "box.json").read_text())
    assert "edits" in content["provenance"]["inputs"]


def test_a_correction_before_the_annotation_equals_one_after_it(box):
    corrected(box, [DROP])
    after = (box / "out" / "box.json").read_text()
    (box / "out" / "box.json").unlink()
    corrected(box, [DROP])
    assert (box / "out" / "box.json").read_text() == after


def test_corrections_survive_a_run_without_them(box):
    corrected(box, [DROP])
    corrections = (box / "out" / "box.json").read_bytes()
    assert run(box / "box.ply", box / "out").skipped == ["box"]
    assert (box / "out" / "box.json").read_bytes() == corrections
    again = run(box / "box.ply", box / "out", BatchOptions(progress=False, overwrite=True))
    assert "--edit" in again.failed["box"]
    assert (box / "out" / "box.json").read_bytes() == corrections


def test_the_same_corrections_are_skipped_and_others_start_from_the_found_symmetries(box):
    corrected(box, [DROP])
    assert corrected(box, [DROP]).skipped == ["box"]
    assert corrected(box, []).done == ["box"]
    again = labels_of(box)
    assert len(again.symmetries) == len(again.found) == 4


def test_an_added_symmetry_is_measured_and_a_bad_one_gives_a_warning(box):
    tilted = {"kind": "reflection", "normal": [0.6, 0.8, 0.0], "point": [0, 0, 0]}
    report = corrected(box, [DROP, {"add": tilted}])
    assert "does not fit" in report.notes["box"]
    labels = labels_of(box)
    assert labels.sources == ("found", "found", "hand", "found")
    assert labels.symmetries[2].error > 0.02
    exact = {"kind": "reflection", "normal": [0.0, 1.0, 0.0], "point": [0, 0, 0]}
    assert "does not fit" not in corrected(box, [DROP, {"add": exact}]).notes["box"]


def test_an_object_without_symmetry_after_correction_has_no_symmetric_region(box):
    drops = [{"drop": {"kind": "reflection", "index": index}} for index in range(3)]
    assert corrected(box, [*drops, {"drop": {"kind": "rotation", "index": 0}}]).done == ["box"]
    assert labels_of(box).symmetries == ()
    assert [region.symmetries for region in labels_of(box).regions] == [()]


def test_corrections_of_an_unknown_object_are_refused_with_the_known_objects(box):
    report = corrected(box, [DROP], name="cup")
    assert report.skipped == ["box"]
    assert "the objects are box" in report.failed["cup"]


def test_a_dry_run_corrects_nothing(box):
    before = (box / "out" / "box.json").read_bytes()
    report = corrected(box, [DROP], BatchOptions(progress=False, dry_run=True))
    assert "would write" in report.notes["box"]
    assert (box / "out" / "box.json").read_bytes() == before


def test_pictures_are_made_of_finished_annotations_and_only_once(box):
    extras = AnnotationExtras(pictures=box / "pictures")

    def draw():
        return annotate_symmetry.run(
            box / "box.ply", box / "out", QUICK, extras=extras, options=QUIET
        )

    report = draw()
    assert report.skipped == ["box"]
    assert "1 object on 1 sheet" in report.notes["pictures"]
    sheet = read_image(box / "pictures" / "sheet_01.png")
    assert len(np.unique(sheet.reshape(-1, 3), axis=0)) > 100
    assert "objects/box.png" in (box / "pictures" / "index.html").read_text()
    assert "pictures" not in draw().notes
    for lost in ("objects/box.png", "sheet_01.png", "index.html"):
        (box / "pictures" / lost).unlink()
        assert "pictures" in draw().notes
        assert (box / "pictures" / lost).is_file()
    corrected(box, [DROP])
    assert "pictures" in draw().notes


def test_pictures_do_not_replace_the_index_of_another_program(box):
    (box / "index.html").write_text("<title>Mine</title>")
    with pytest.raises(SymgraspError, match="is no page of annotate-symmetry; choose another"):
        annotate_symmetry.run(
            box / "box.ply", box / "out", QUICK, extras=AnnotationExtras(pictures=box)
        )
    assert (box / "index.html").read_text() == "<title>Mine</title>"


def test_a_picture_that_failed_is_drawn_by_the_next_run(box, monkeypatch):
    extras = AnnotationExtras(pictures=box / "later")

    def draw():
        return annotate_symmetry.run(
            box / "box.ply", box / "out", QUICK, extras=extras, options=QUIET
        )

    def failing(*_):
        raise SymgraspError("no picture")

    with monkeypatch.context() as patched:
        patched.setattr("pipelines.annotation.extras.object_views", failing)
        assert draw().failed == {"picture of box": "no picture"}
    assert draw().failed == {}
    assert (box / "later" / "objects" / "box.png").is_file()


def test_bops_file_is_written_and_a_file_of_others_is_not_replaced(box):
    path = box / "models_info.json"
    extras = AnnotationExtras(bop=path)
    annotate_symmetry.run(box / "box.ply", box / "out", QUICK, extras=extras, options=QUIET)
    info = json.loads(path.read_text())
    assert len(info["1"]["symmetries_discrete"]) == 3
    assert info["1"]["size_x"] == pytest.approx(120.0, abs=1e-3)
    sidecar_of(path).unlink()
    with pytest.raises(SymgraspError, match="other settings"):
        annotate_symmetry.run(box / "box.ply", box / "out", QUICK, extras=extras, options=QUIET)


def test_bops_file_of_a_killed_run_is_made_again(box, monkeypatch):
    path, write = box / "models_info.json", bop_models_info.write

    def killed(*given):
        write(*given)
        raise KeyboardInterrupt

    def run():
        extras = AnnotationExtras(bop=path)
        annotate_symmetry.run(box / "box.ply", box / "out", QUICK, extras=extras, options=QUIET)

    with monkeypatch.context() as patched:
        patched.setattr(bop_models_info, "write", killed)
        with pytest.raises(KeyboardInterrupt):
            run()
    run()
    assert "1" in json.loads(path.read_text())


def test_bops_rotation_replaces_the_one_found(tmp_path):
    write_mesh(tmp_path / "obj_000004.ply", shapes()[1])
    axis = {"axis": [0, 0, 1], "offset": [0, 0, 0]}
    path = tmp_path / "models_info.json"
    path.write_text(json.dumps({"4": {"symmetries_continuous": [axis]}}))
    extras = AnnotationExtras(bop_symmetries=path)
    report = annotate_symmetry.run(
        tmp_path / "obj_000004.ply", tmp_path / "out", QUICK, extras=extras, options=QUIET
    )
    assert "does not fit" not in report.notes["obj_000004"]
    labels = symmetry_labels.read(tmp_path / "out" / "obj_000004.json")
    assert labels.sources == ("found", "bop")
    assert labels.symmetries[1].axis.tolist() == [0.0, 0.0, 1.0]


def given_by_bop(tmp_path, content):
    """Annotate the meshes of `tmp_path` with a models_info.json of `content`."""
    path = tmp_path / "models_info.json"
    path.write_text(json.dumps(content))
    extras = AnnotationExtras(bop_symmetries=path)
    return annotate_symmetry.run(tmp_path, tmp_path / "out", QUICK, extras=extras, options=QUIET)


def test_objects_missing_in_bops_file_are_named(tmp_path):
    for number in (4, 5):
        write_mesh(tmp_path / f"obj_{number:06d}.ply", shapes()[1])
    axis = {"axis": [0, 0, 1], "offset": [0, 0, 0]}
    report = given_by_bop(tmp_path, {"4": {"symmetries_continuous": [axis]}, "9": {}})
    assert report.done == ["obj_000004", "obj_000005"]
    assert report.notes["models_info.json"].startswith("has no entry of obj_000005;")


def test_bops_file_of_other_objects_is_refused_before_any_is_annotated(tmp_path):
    write_mesh(tmp_path / "obj_000004.ply", shapes()[1])
    with pytest.raises(SymgraspError, match="has no entry of obj_000004; it has entries of 7, 8"):
        given_by_bop(tmp_path, {"7": {}, "8": {}})
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("stamp", ["me", {"inputs": "me"}])
def test_an_annotation_that_would_replace_a_handmade_file_fails_alone(box, stamp):
    write_mesh(box / "can.ply", shapes()[1])
    (box / "out" / "can.json").write_text(json.dumps({"symmetries": [], "provenance": stamp}))
    report = run(box, box / "out")
    assert report.skipped == ["box"]
    assert "--overwrite" in report.failed["can"]
    path = box / "edits.json"
    path.write_text(json.dumps({"can": []}))
    extras = AnnotationExtras(edits=path)
    report = annotate_symmetry.run(box, box / "out", QUICK, extras=extras, options=QUIET)
    assert "--overwrite" in report.failed["can"]


def test_regions_of_parts_are_named_and_cover_the_object():
    mesh, rng = shapes()[2], np.random.default_rng(0)
    labels, notes = annotate(mesh, "pair", QUICK, rng)
    assert {region.name for region in labels.regions} == {"body0", "part0"}
    triangles = np.concatenate([region.triangles for region in labels.regions])
    assert len(triangles) == len(mesh.faces)
    assert notes == ()
