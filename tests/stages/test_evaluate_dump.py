"""`evaluate --protocol graspnet` against graspnetAPI, and on dumps that break graspnetAPI."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from pipelines import evaluate_dump
from pipelines.configs import EvaluateDumpConfig
from pipelines.dataset import convex_pieces
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.signed_distance import write_sdf
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.errors import FormatError, StaleOutputError
from pipelines.evaluation.graspnet.dump_verdicts import read_dump_verdicts, scenes_folder
from pipelines.evaluation.graspnet.graspnet_truth import grid_object
from pipelines.evaluation.reports import reports
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.numerics.single_precision import single_precision_grid
from pipelines.geometry.transforms import rotation_about
from pipelines.runtime.batch import BatchOptions, StageReport
from symgrasp_cli.app import app
from tests.stages.toy_dump import frame_file, write_dump, write_root

# Results of GraspNetEval.eval_scene of graspnetAPI 1.2.11 for the ranked grasps of `write_dump` on
# `write_root`, with the textured.sdf that `label-grasps` writes next to textured.obj.
N = -1.0
PEER = {
    (100, 0): [N, 0.4, 0.6, 0.2, 0.4, N, N, N, N, N, N, N, N, 0.8],
    (100, 1): [0.2, 0.6, N, 0.2, N, N, N, N, 0.2, 0.2],
    (160, 0): [0.2, N, N, 0.2, 0.2, N, 0.2, 0.4, N, 0.8, 0.6, N],
    (160, 1): [N, 0.2, N, 0.6, N, N, 0.6, N],
}
PEER_AP = {"seen": 0.23203575323630057, "novel": 0.2174331168184574}
PEER_AP04 = {"seen": 0.19197611971480577, "novel": 0.17035708220452736}
PEER_AP08 = {"seen": 0.270150942313351, "novel": 0.24991259732500598}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> GraspNetRoot:
    return write_root(tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dump(tmp_path_factory.mktemp("dump"))


@pytest.fixture
def dump(pristine: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(pristine, tmp_path / "dump"))


def run(dump: Path, root: GraspNetRoot, output: Path, **options) -> StageReport:
    chosen = {name: options.pop(name) for name in ("exact", "frame_stride") if name in options}
    config = EvaluateDumpConfig(**chosen)
    return evaluate_dump.run(
        dump, root.root, output, config, BatchOptions(progress=False, **options)
    )


def figures(output: Path, split: str = "all") -> dict:
    return reports.read_report(output)["rows"]["realsense"][split]


def verdicts(output: Path, scene_id: int) -> dict:
    folder = scenes_folder(output)
    return read_dump_verdicts(folder / f"scene_{scene_id:04d}_realsense.npz")


@pytest.fixture(scope="module")
def report(root, pristine, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("report") / "report.json"
    assert run(pristine, root, output).exit_code == 0
    return output


@pytest.mark.parametrize(("scene_id", "frame"), PEER)
def test_every_ranked_grasp_is_judged_as_by_graspnetapi(report, scene_id, frame):
    friction = verdicts(report, scene_id)["friction"][frame]
    assert friction[np.isfinite(friction)].tolist() == PEER[scene_id, frame]


@pytest.mark.parametrize("split", ["seen", "novel"])
def test_the_average_precisions_equal_those_of_graspnetapi(report, split):
    found = figures(report, split)
    assert found["ap"] == pytest.approx(PEER_AP[split], abs=1e-15)
    assert found["ap_0.4"] == pytest.approx(PEER_AP04[split], abs=1e-15)
    assert found["ap_0.8"] == pytest.approx(PEER_AP08[split], abs=1e-15)
    assert found["ap_by_friction"]["0.8"] == found["ap_0.8"]


def test_the_figure_of_all_is_the_mean_over_frames_and_a_split_without_frames_has_none(report):
    assert figures(report)["ap"] == pytest.approx(np.mean(list(PEER_AP.values())))
    assert figures(report, "similar")["ap"] is None
    assert figures(report)["frames"] == 4
    assert sum(figures(report)["reasons"].values()) == sum(map(len, PEER.values()))


def test_a_grid_on_disk_gives_the_same_verdicts_as_a_computed_one(root, pristine, report, tmp_path):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    mesh = read_mesh(other.textured_path(1, ".obj"))
    write_sdf(other.textured_path(1, ".sdf"), single_precision_grid(mesh))
    computed, stored = grid_object(root, 1).grid, grid_object(other, 1).grid
    np.testing.assert_array_equal(computed.values, stored.values)
    assert computed.spacing == stored.spacing
    assert run(pristine, other, tmp_path / "r.json").exit_code == 0
    for scene_id in (100, 160):
        theirs, ours = verdicts(tmp_path / "r.json", scene_id), verdicts(report, scene_id)
        np.testing.assert_array_equal(theirs["friction"], ours["friction"])


def test_grasps_that_hold_for_the_peer_hold_with_exact_contacts_except_for_collision(
    root, pristine, tmp_path
):
    output = tmp_path / "exact.json"
    assert run(pristine, root, output, exact=True).exit_code == 0
    assert reports.read_report(output)["exact"] is True
    held = {s: verdicts(output, s)["friction"] for s in (100, 160)}
    both = [(held[s][f][: len(PEER[s, f])], np.array(PEER[s, f])) for s, f in PEER]
    # Triangles collide with more grasps than voxels; a grasp free in both holds in both.
    for ours, theirs in both:
        free = (ours > 0) & (theirs > 0)
        assert free.any()
        assert (np.abs(ours[free] - theirs[free]) < 0.21).all()


def test_an_empty_dump_scores_nothing(root, dump, tmp_path):
    for index, empty in enumerate((np.zeros((0, 17)), np.zeros(0))):
        np.save(frame_file(dump, 100, index), empty)
    assert run(dump, root, tmp_path / "r.json").exit_code == 0
    assert figures(tmp_path / "r.json", "seen")["ap"] == 0.0
    assert figures(tmp_path / "r.json", "novel")["ap"] == pytest.approx(PEER_AP["novel"])


def test_a_missing_frame_is_named_and_counts_as_a_frame_without_grasps(root, dump, tmp_path):
    frame_file(dump, 100, 1).unlink()
    report = run(dump, root, tmp_path / "r.json")
    assert report.exit_code == 1
    assert "0001.npy is missing" in report.failed["scene_0100_realsense"]
    found = figures(tmp_path / "r.json", "seen")
    assert (found["frames"], found["frames_absent"]) == (2, 1)
    assert found["ap"] == pytest.approx(found["ap_present"] / 2.0)


def test_a_dump_whose_name_is_not_utf8_has_a_page(root, dump, tmp_path):
    odd = dump.rename(tmp_path / os.fsdecode(b"<b>\xff"))
    for index in (0, 1):
        frame_file(odd, 100, index).unlink()
    report = run(odd, root, tmp_path / "r.json")
    assert "<b>%FF" in report.failed["scene_0100_realsense"]
    assert (tmp_path / "r.html").read_text(encoding="utf-8").count("&lt;b&gt;%FF") >= 2


def test_a_frame_without_images_and_grasps_does_not_count_until_it_has_one(root, dump, tmp_path):
    copied = GraspNetRoot(shutil.copytree(root.root, tmp_path / "root"))
    frame_file(dump, 100, 1).unlink()
    scene = copied.scene(100, "realsense")
    images = [scene.frame(1).path(kind) for kind in ("rgb", "depth", "label")]
    color = images[0].read_bytes()
    for image in images:
        image.unlink()
    assert run(dump, copied, tmp_path / "r.json").exit_code == 0
    assert figures(tmp_path / "r.json", "seen")["frames"] == 1
    images[0].write_bytes(color)
    report = run(dump, copied, tmp_path / "r.json", overwrite=True)
    assert list(report.failed) == ["scene_0100_realsense"]
    found = figures(tmp_path / "r.json", "seen")
    assert (found["frames"], found["frames_absent"]) == (2, 1)


def test_a_scene_that_the_dump_lacks_is_noted_if_it_has_others_of_the_split(root, dump, tmp_path):
    copied = GraspNetRoot(shutil.copytree(root.root, tmp_path / "root"))
    shutil.copytree(copied.scene_folder(100), copied.scene_folder(101))
    shutil.rmtree(frame_file(dump, 160, 0).parents[1])
    shutil.copy(frame_file(dump, 100, 0), frame_file(dump, 100, 9))  # not in the dataset
    for _ in range(2):  # the second run finds all scenes finished
        notes = run(dump, copied, tmp_path / "r.json").notes
        assert list(notes) == ["realsense, seen", "scene_0100_realsense"]
        assert "1 of 2 scenes" in notes["realsense, seen"]
        assert "scene_0101" in notes["realsense, seen"]
        assert "left out 1 dumped frame" in notes["scene_0100_realsense"]
    assert reports.read_report(tmp_path / "r.json")["notes"] == notes
    page = (tmp_path / "r.html").read_text()
    assert all(f"{name}: {note}" in page for name, note in notes.items())


def test_a_scene_of_the_dataset_without_cameras_is_named(root, dump, tmp_path, caplog):
    copied = GraspNetRoot(shutil.copytree(root.root, tmp_path / "root"))
    copied.scene_folder(101).mkdir()
    assert run(dump, copied, tmp_path / "r.json").exit_code == 0
    sentence = f"{copied.scene_folder(101)} has no folder kinect or realsense, so it is left out"
    assert caplog.messages.count(sentence) == 1


def test_an_unreadable_frame_is_not_taken_for_one_that_a_stride_left_out(root, dump, tmp_path):
    np.save(frame_file(dump, 100, 1), np.ones((3, 16)))
    sentence = run(dump, root, tmp_path / "r.json").failed["scene_0100_realsense"]
    assert sentence.startswith("1 of 2 frames are unreadable and count as without grasps: ")
    assert "(3, 16)" in sentence
    assert "--frame-stride" not in sentence


def test_with_a_stride_only_its_frames_count(root, dump, tmp_path):
    for scene_id in (100, 160):
        frame_file(dump, scene_id, 1).unlink()
    every = run(dump, root, tmp_path / "every.json")
    assert "--frame-stride N" in every.failed["scene_0100_realsense"]
    assert run(dump, root, tmp_path / "r.json", frame_stride=2).exit_code == 0
    found = figures(tmp_path / "r.json")
    assert (found["frames"], found["frames_absent"]) == (2, 0)
    assert found["ap"] == pytest.approx(figures(tmp_path / "every.json")["ap_present"])


def test_a_dumped_frame_that_the_stride_leaves_out_does_not_count(root, dump, tmp_path):
    assert run(dump, root, tmp_path / "r.json", frame_stride=2).exit_code == 0
    assert figures(tmp_path / "r.json")["frames"] == 2


@pytest.mark.parametrize("content", [np.zeros((3, 7)), np.zeros(17), np.array(["grasp"])])
def test_a_file_of_another_shape_is_named_and_the_rest_is_judged(root, dump, tmp_path, content):
    np.save(frame_file(dump, 160, 0), content)
    report = run(dump, root, tmp_path / "r.json")
    assert set(report.failed) == {"scene_0160_realsense"}
    assert "17" in report.failed["scene_0160_realsense"]
    assert figures(tmp_path / "r.json", "seen")["ap"] == pytest.approx(PEER_AP["seen"])


def test_a_cut_off_file_is_named(root, dump, tmp_path):
    path = frame_file(dump, 160, 0)
    path.write_bytes(path.read_bytes()[:500])
    assert "0000.npy" in run(dump, root, tmp_path / "r.json").failed["scene_0160_realsense"]


def test_rows_that_are_no_grasps_are_left_out_and_named(root, dump, tmp_path, report):
    path = frame_file(dump, 100, 0)
    rows = np.load(path)
    bad = rows[:3].copy()
    bad[0, 13], bad[1, 4:13], bad[2, 0] = np.nan, 0.0, np.inf
    np.save(path, np.concatenate([bad, rows]))
    done = run(dump, root, tmp_path / "r.json")
    assert (
        "row 0 holds numbers that are not finite, 3 of its rows"
        in done.failed["scene_0100_realsense"]
    )
    found, before = verdicts(tmp_path / "r.json", 100), verdicts(report, 100)
    np.testing.assert_array_equal(found["friction"], before["friction"])
    assert found["left_out"].tolist() == [3, 0]
    assert found["row"][0][0] == before["row"][0][0] + 3


def test_rows_in_millimetres_are_named(root, dump, tmp_path):
    path = frame_file(dump, 100, 0)
    rows = np.load(path)
    rows[:, 13:16] *= 1000.0
    np.save(path, rows)
    failed = run(dump, root, tmp_path / "r.json").failed
    assert "row 0 holds lengths beyond 100 metres" in failed["scene_0100_realsense"]


def test_rotations_a_little_off_are_straightened_and_counted(root, dump, tmp_path):
    path = frame_file(dump, 100, 0)
    rows = np.load(path)
    rows[:5, 4:13] *= 1.01
    np.save(path, rows)
    assert run(dump, root, tmp_path / "r.json").exit_code == 0
    assert verdicts(tmp_path / "r.json", 100)["friction"][0][:14].tolist() == PEER[100, 0]
    assert figures(tmp_path / "r.json")["rows_straightened"] == 5


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_dumps_of_lower_precision_are_read(root, dump, tmp_path, dtype):
    for path in dump.rglob("*.npy"):
        np.save(path, np.load(path).astype(dtype))
    assert run(dump, root, tmp_path / "r.json").exit_code == 0
    assert figures(tmp_path / "r.json")["ap"] == pytest.approx(0.225, abs=0.08)


def test_widths_are_clipped_and_a_closed_hand_holds_nothing(root, dump, tmp_path):
    path = frame_file(dump, 100, 0)
    rows = np.load(path)
    rows[:, 1] = np.where(np.arange(len(rows)) % 2, 0.0, -0.01)
    np.save(path, rows)
    assert run(dump, root, tmp_path / "r.json").exit_code == 0
    assert verdicts(tmp_path / "r.json", 100)["accuracy"][0].max() == 0.0


def test_a_wrong_folder_is_refused_with_the_expected_layout(root, dump, tmp_path):
    with pytest.raises(FormatError, match=r"scene_NNNN.*folder dump in it holds scenes"):
        run(dump.parent, root, tmp_path / "r.json")
    with pytest.raises(FormatError, match="scene_NNNN"):
        run(root.root, root, tmp_path / "r.json")


def test_a_scene_that_the_dataset_lacks_fails_alone(root, dump, tmp_path):
    shutil.copytree(dump / "scene_0100", dump / "scene_0101")
    report = run(dump, root, tmp_path / "r.json")
    assert set(report.failed) == {"scene_0101_realsense"}
    assert figures(tmp_path / "r.json")["frames"] == 4


def test_no_report_is_written_if_the_dataset_lacks_all_scenes(root, dump, tmp_path):
    (dump / "scene_0100").rename(dump / "scene_0101")
    shutil.rmtree(dump / "scene_0160")
    arguments = ["--dataset", str(root.root), "--protocol", "graspnet"]
    out = tmp_path / "new" / "r.json"
    result = CliRunner().invoke(app, ["evaluate", str(dump), *arguments, "--out", str(out)])
    assert result.exit_code == 1
    assert "error: scene_0101_realsense: " in result.output
    assert not out.exists()


def test_finished_scenes_are_skipped_and_workers_change_nothing(root, pristine, tmp_path):
    output = tmp_path / "r.json"
    run(pristine, root, output, workers=2)
    written = {
        path.name: path.read_bytes() for path in output.parent.rglob("*.*") if path.is_file()
    }
    (scenes_folder(output) / "scene_0100_realsense.npz").unlink()
    again = run(pristine, root, output)
    assert (again.done, again.skipped) == (["scene_0100_realsense"], ["scene_0160_realsense"])
    after = {path.name: path.read_bytes() for path in output.parent.rglob("*.*") if path.is_file()}
    assert after == written
    with pytest.raises(StaleOutputError):
        run(pristine, root, output, exact=True)


def test_a_report_on_a_dataset_of_other_poses_is_not_reused(root, pristine, tmp_path):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    run(pristine, root, tmp_path / "report.json")
    annotation = other.frame("scenes/scene_0100/realsense/0000").path("annotations")
    annotation.write_text(annotation.read_text().replace("<pos_in_world>", "<pos_in_world> "))
    with pytest.raises(StaleOutputError):
        run(pristine, other, tmp_path / "report.json")


def test_another_mesh_makes_a_report_stale(root, pristine, tmp_path):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    output = tmp_path / "r.json"
    run(pristine, other, output, exact=True)
    before = figures(output)
    path = other.textured_path(1, ".obj")
    mesh = read_mesh(path)
    write_mesh(path, Mesh(mesh.vertices @ rotation_about([1.0, 0.0, 0.0], 0.4), mesh.faces))
    with pytest.raises(StaleOutputError):
        run(pristine, other, output, exact=True)
    output.unlink()
    assert len(run(pristine, other, output, exact=True).done) == 2
    assert figures(output) != before


def test_a_broken_mesh_is_named(root, pristine, tmp_path):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    other.model_path(1).write_bytes(b"nothing")
    report = run(pristine, other, tmp_path / "r.json")
    assert len(report.failed) == 2
    assert all("nontextured.ply" in sentence for sentence in report.failed.values())


def test_verdicts_of_former_scenes_do_not_stay_beside_a_new_report(root, dump, tmp_path):
    run(dump, root, tmp_path / "r.json")
    shutil.rmtree(dump / "scene_0160")
    run(dump, root, tmp_path / "r.json", overwrite=True)
    left = [path.name for path in scenes_folder(tmp_path / "r.json").iterdir()]
    assert all(name.startswith("scene_0100_realsense.npz") for name in left)


def test_a_report_names_the_scenes_that_it_lacks(root, dump, tmp_path):
    other = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    for path in other.scene_folder(160).rglob("annotations/*.xml"):
        path.write_text("<scene>")
    frame_file(dump, 100, 0).unlink()  # its scene is evaluated
    report = run(dump, other, tmp_path / "r.json")
    assert sorted(report.failed) == ["scene_0100_realsense", "scene_0160_realsense"]
    lacking = {"scene_0160_realsense": report.failed["scene_0160_realsense"]}
    assert reports.read_report(tmp_path / "r.json")["failed"] == lacking


def test_the_command_prints_the_figures(root, pristine, tmp_path):
    arguments = ["--dataset", str(root.root), "--out", str(tmp_path / "r.json")]
    result = CliRunner().invoke(
        app, ["evaluate", str(pristine), *arguments, "--protocol", "graspnet"]
    )
    assert result.exit_code == 0, result.output
    assert "23.20" in result.output
    page = (tmp_path / "r.html").read_text()
    assert "23.20" in page
    assert "http" not in page


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--protocol", "cocoa"],
        ["--protocol", "graspnet", "--baselines"],
        ["--protocol", "graspnet", "--with", "pyproject.toml"],
        ["--exact"],
    ],
)
def test_options_that_exclude_each_other_are_wrong_usage(root, pristine, tmp_path, options):
    arguments = ["--dataset", str(root.root), "--out", str(tmp_path / "r.json"), *options]
    assert CliRunner().invoke(app, ["evaluate", str(pristine), *arguments]).exit_code == 2


@pytest.mark.parametrize("exact", [False, True])
def test_grasps_inside_a_bin_collide_with_it(root, pristine, tmp_path, exact):
    walled = GraspNetRoot(Path(shutil.copytree(root.root, tmp_path / "root")))
    scene = walled.scene(100, walled.scenes()[0].camera)
    slabs = [trimesh.creation.box((0.36, 0.36, 0.002)) for _ in range(8)]
    for number, slab in enumerate(slabs):  # no object of the scene is free of them
        slab.apply_translation((0.0, 0.0, 0.03 * number))
    convex_pieces.write(
        scene.surroundings_path, [Mesh(np.asarray(s.vertices), np.asarray(s.faces)) for s in slabs]
    )
    run(pristine, walled, tmp_path / "r.json", exact=exact)
    found = verdicts(tmp_path / "r.json", 100)
    assert np.isinf(found["friction"][np.isfinite(found["friction"])]).sum() == 0
    assert (found["friction"][0][np.isfinite(found["friction"][0])] < 0).all()
