"""The pack stage: region clouds with the labels of the posed objects."""

import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines import annotate_symmetry, pack, refine_grasps, train
from pipelines.configs import AnnotateSymmetryConfig, PackConfig, RefineGraspsConfig, TrainConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.training import packed_regions
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.region_masks import RegionedObject, visible_regions
from pipelines.geometry.symmetry import (
    ROTATION_SLOT,
    SPHERE_SLOT,
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.transforms import invert, make_pose, random_rotation, transform_points, unit
from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.provenance import digest, make_stamp
from tests.stages.dataset_root import write_root

QUIET = BatchOptions(progress=False)
CONFIG = PackConfig(num_points=256, min_pixels=100)
NAME = "scene_0000_realsense"


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"))
    annotate = AnnotateSymmetryConfig(
        num_samples=8000, num_verification_samples=1000, plane_directions=400, axis_directions=250
    )
    annotate_symmetry.run(made.root, None, annotate, options=QUIET)
    refine = RefineGraspsConfig(copies_per_turn=12, num_surface_points=1024)
    refine_grasps.run(made.root, refine, options=QUIET)
    return made


@pytest.fixture(scope="module")
def packed(root, tmp_path_factory):
    out = tmp_path_factory.mktemp("packed")
    pack.run(root.root, out, CONFIG, options=QUIET)
    return packed_regions.read(out / f"{NAME}.h5")


@pytest.fixture(scope="module")
def surfaces(root):
    """Return the surface of each object, object frame."""
    meshes = [read_mesh(root.model_path(object_id)) for object_id in root.object_ids()]
    return [Surface.from_mesh(mesh, 20000, np.random.default_rng(0)) for mesh in meshes]


def poses_of(root, frame_id):
    frame = root.scene(0).frame(frame_id)
    return {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(frame)}


def test_every_visible_region_of_every_frame_is_packed(packed):
    found = {
        (int(frame), int(object_id), str(name))
        for frame, object_id, name in zip(
            packed.frame_id, packed.object_id, packed.name, strict=True
        )
    }
    for frame in (0, 1):
        assert {(frame, 0, "whole"), (frame, 1, "whole"), (frame, 2, "part0")} <= found


def test_only_empty_slots_are_nan(packed):
    assert np.isfinite(packed.points).all()
    assert ((packed.affordance >= 0) & (packed.affordance <= 1)).all()
    full = packed.existence > 0.5
    assert np.isfinite(packed.point[full]).all()
    assert np.isnan(packed.point[~full]).all()


def test_most_points_lie_on_their_posed_object(root, packed, surfaces):
    for row in range(len(packed)):
        object_id = int(packed.object_id[row])
        pose = poses_of(root, int(packed.frame_id[row]))[object_id]
        points_obj = transform_points(invert(pose), packed.points[row])
        assert np.mean(surfaces[object_id].distances(points_obj)[0] < 0.003) > 0.6


def test_symmetries_equal_the_objects_moved_by_its_pose(root, packed):
    for row in range(len(packed)):
        object_id = int(packed.object_id[row])
        pose = poses_of(root, int(packed.frame_id[row]))[object_id]
        regions = symmetry_labels.read(root.symmetry_path(object_id)).regions
        region = next(region for region in regions if region.name == packed.name[row])
        expected = SymmetrySlots.from_symmetries(
            symmetry.transformed(pose) for symmetry in region.symmetries
        )
        assert_array_equal(packed.existence[row], expected.probability)
        assert_allclose(packed.point[row], expected.point, atol=1e-6)
        assert_allclose(packed.direction[row], expected.direction, atol=1e-6)


def test_points_that_leak_out_of_the_object_have_no_affordance(root, packed, surfaces):
    for row in range(len(packed)):
        object_id = int(packed.object_id[row])
        pose = poses_of(root, int(packed.frame_id[row]))[object_id]
        points_obj = transform_points(invert(pose), packed.points[row])
        away = surfaces[object_id].distances(points_obj)[0] > CONFIG.label_radius + 0.002
        assert not packed.affordance[row][away].any()


def test_the_same_seed_packs_the_same_bytes_and_another_does_not(root, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        pack.run(root.root, tmp_path / name, CONFIG, seed=seed, options=QUIET)
    files = [(tmp_path / name / f"{NAME}.h5").read_bytes() for name in "abc"]
    assert files[0] == files[1]
    assert files[0] != files[2]


def test_exact_masks_hold_only_points_of_the_region(root, surfaces, tmp_path):
    config = PackConfig(num_points=256, min_pixels=100, mask_noise=False)
    pack.run(root.root, tmp_path, config, options=QUIET)
    scene = packed_regions.read(tmp_path / f"{NAME}.h5")
    for row in range(len(scene)):
        object_id = int(scene.object_id[row])
        pose = poses_of(root, int(scene.frame_id[row]))[object_id]
        points_obj = transform_points(invert(pose), scene.points[row])
        assert np.mean(surfaces[object_id].distances(points_obj)[0] < 0.003) > 0.97


def test_regions_that_show_too_little_are_left_out(root, tmp_path):
    pack.run(root.root, tmp_path, PackConfig(min_pixels=10**6), options=QUIET)
    assert len(packed_regions.read(tmp_path / f"{NAME}.h5")) == 0


def test_a_finished_scene_is_skipped(root, tmp_path):
    pack.run(root.root, tmp_path, CONFIG, options=QUIET)
    assert pack.run(root.root, tmp_path, CONFIG, options=QUIET).skipped == [NAME]


def test_scenes_that_are_not_packed_yet_or_damaged_do_not_stop_the_report(root, tmp_path):
    shutil.copytree(root.root, tmp_path / "copy")
    scenes, out = tmp_path / "copy" / "scenes", tmp_path / "out"
    pack.run(tmp_path / "copy", out, CONFIG, options=QUIET)
    shutil.copytree(scenes / "scene_0000", scenes / "scene_0001")
    planned = replace(QUIET, dry_run=True)
    notes = pack.run(tmp_path / "copy", out, CONFIG, options=planned).notes
    assert list(notes) == ["scene_0001_realsense"]  # would be packed: no lack of scenes
    (out / "scene_0001_realsense.h5").write_bytes(b"damaged")
    report = pack.run(tmp_path / "copy", out, CONFIG, options=QUIET)
    assert list(report.failed) == ["scene_0001_realsense"]
    assert "regions" in report.notes


def test_train_is_next_only_if_it_can_hold_out_a_scene(root, tmp_path):
    shutil.copytree(root.root, tmp_path / "copy")
    scenes, config = tmp_path / "copy" / "scenes", TrainConfig()
    for count in (1, 2):
        report = pack.run(tmp_path / "copy", tmp_path / "out", CONFIG, options=QUIET)
        try:
            train.region_sets(tmp_path / "out", None, config, 0)
        except ValueRangeError:
            assert not report.has_next
            assert report.notes["regions"].startswith("of 1 scene; train needs those of 2")
        else:
            assert report.has_next
            assert "regions" not in report.notes
            assert count == 2
        shutil.copytree(scenes / "scene_0000", scenes / f"scene_{count:04d}")


def test_packed_scenes_of_other_runs_in_the_folder_are_named(root, tmp_path):
    assert list(pack.run(root.root, tmp_path, CONFIG, options=QUIET).notes) == [NAME, "regions"]
    former = tmp_path / "scene_0009_kinect.h5"
    shutil.copy(tmp_path / f"{NAME}.h5", former)
    note = pack.run(root.root, tmp_path, CONFIG, options=QUIET).notes[str(tmp_path)]
    assert note.startswith("1 packed scene of other runs, which train reads too")
    assert str(former) in note


def test_a_scene_whose_pictures_were_replaced_is_not_reused(root, tmp_path):
    shutil.copytree(root.root, tmp_path / "copy")
    assert pack.run(tmp_path / "copy", tmp_path / "out", CONFIG, options=QUIET).done
    assert pack.run(tmp_path / "copy", tmp_path / "out", CONFIG, options=QUIET).skipped
    path = GraspNetRoot(tmp_path / "copy").scene(0).frame(1).path("depth")
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(
        str(path), np.where(depth > 0, depth + np.indices(depth.shape)[0] % 3, 0).astype("u2")
    )
    again = pack.run(tmp_path / "copy", tmp_path / "out", CONFIG, options=QUIET)
    assert "other settings or inputs" in again.failed[NAME]


def test_a_file_in_place_of_the_output_folder_is_named_before_any_work(root, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SymgraspError, match="file is a file; name a folder"):
        pack.run(root.root, tmp_path / "file", PackConfig())


def test_a_split_without_scenes_is_reported_in_one_sentence(root, tmp_path):
    with pytest.raises(SymgraspError, match="novel scene"):
        pack.run(root.root, tmp_path, CONFIG, split="novel", options=QUIET)


def test_counterparts_of_packed_points_lie_on_the_posed_object(root, surfaces, tmp_path):
    config = PackConfig(num_points=256, min_pixels=100, mask_noise=False)
    pack.run(root.root, tmp_path, config, options=QUIET)
    reader, checked = PackedReader(tmp_path), 0
    for region in (reader[i] for i in range(len(reader))):
        to_object = invert(poses_of(root, region.frame_id)[region.object_id])
        slots = SymmetrySlots(region.existence, region.point, region.direction)
        for slot in np.flatnonzero(slots.probability > 0.5):
            images = slots.symmetry(slot).counterpart(region.points)
            gap = surfaces[region.object_id].distances(transform_points(to_object, images))[0]
            assert np.mean(gap < 0.003) > 0.95
            checked += 1
    assert checked > 6


# Two separate boxes, so that each is a region that is partly visible in every pose.
BOXES = [trimesh.creation.box((0.05, 0.05, 0.05)) for _ in range(2)]
BOXES[1].apply_translation((0.09, 0.0, 0.0))
PAIR = trimesh.util.concatenate(BOXES)
PAIR_MESH = Mesh(np.asarray(PAIR.vertices), np.asarray(PAIR.faces))
CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_symmetries_in_the_camera_frame_are_symmetries_of_the_posed_points(seed):
    rng = np.random.default_rng(seed)
    pose = make_pose(random_rotation(rng), [*rng.uniform(-0.05, 0.05, 2), 0.5])
    regions = [
        ObjectRegion(
            name,
            triangles,
            (
                *(ReflectionSymmetry(unit(rng.normal(size=3)), rng.normal(size=3)) for _ in "abc"),
                RotationSymmetry(unit(rng.normal(size=3)), rng.normal(size=3)),
                SphereSymmetry(rng.normal(size=3)),
            ),
        )
        for name, triangles in (("left", np.arange(12)), ("right", np.arange(12, 24)))
    ]
    label = np.ones((48, 64), np.uint8)
    posed = {0: RegionedObject(PAIR_MESH, tuple(regions))}
    found = visible_regions(label, CAMERA, [(0, pose)], posed)
    assert {each.name for each in found} <= {"left", "right"}
    assert found
    points = rng.normal(size=(9, 3))
    angle = rng.uniform(-np.pi, np.pi)
    for instance in found:
        known = next(region for region in regions if region.name == instance.name)
        slots = SymmetrySlots.from_symmetries(instance.symmetries)
        for slot, symmetry in zip(range(5), known.symmetries, strict=True):
            in_camera = slots.symmetry(slot)
            reflected = in_camera.counterpart(transform_points(pose, points))
            expected = transform_points(pose, symmetry.counterpart(points))
            assert_allclose(reflected, expected, atol=1e-9)
        axis, turned = slots.symmetry(ROTATION_SLOT), known.symmetries[3].turn(points, angle)
        assert_allclose(
            axis.turn(transform_points(pose, points), angle),
            transform_points(pose, turned),
            atol=1e-9,
        )
        center = transform_points(pose, known.symmetries[4].point)
        assert_allclose(slots.point[SPHERE_SLOT], center, atol=1e-12)


def changed_text(kind, old, new):
    def damage(camera):
        path = camera / kind
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return damage


def without_pose(camera):
    path = camera / "annotations" / "0001.xml"
    text = path.read_text()
    path.write_text(text[: text.rindex("<obj>")] + "</scene>")


def smaller_depth(camera):
    cv2.imwrite(str(camera / "depth/0001.png"), np.full((120, 160), 600, np.uint16))


def cut_depth(camera):
    path = camera / "depth/0001.png"
    path.write_bytes(path.read_bytes()[:500])


def unknown_object(camera):
    cv2.imwrite(str(camera / "label/0001.png"), np.full((240, 320), 60, np.uint8))


BOMB = '<!DOCTYPE s [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><scene>&b;'
# A fault of a scene, and words of the error about it.
FAULTS = {
    "a depth image is missing": (lambda c: (c / "depth/0000.png").unlink(), "depth/0000.png does"),
    "depth of another size": (smaller_depth, "160x120"),
    "depth cut off": (cut_depth, "cut off"),
    "no pose of an object": (without_pose, "0001.xml: holds no pose of object 2"),
    "no annotation": (lambda c: (c / "annotations/0001.xml").unlink(), "0001.xml does not exist"),
    "entities": (changed_text("annotations/0000.xml", "<scene>", BOMB), "not XML"),
    "not rigid": (
        changed_text("annotations/0000.xml", "<ori_in_world>", "<ori_in_world>3"),
        "object 0",
    ),
    "no object list": (lambda c: (c.parent / "object_id_list.txt").unlink(), "object_id_list"),
    "an object of no scene": (unknown_object, "shows object 59"),
    "no camera": (lambda c: np.save(c / "camK.npy", np.eye(4)), "camK.npy"),
}


def test_scenes_at_fault_give_one_sentence_each_and_the_rest_is_packed(root, tmp_path):
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    for number, (damage, _) in enumerate(FAULTS.values(), start=1):
        shutil.copytree(other.scene_folder(0), other.scene_folder(number))
        damage(other.scene_folder(number) / "realsense")
    report = pack.run(other.root, tmp_path / "out", CONFIG, options=QUIET)
    assert report.done == [NAME]
    assert report.exit_code == 1
    assert len(report.failed) == len(FAULTS)
    for sentence, (_, words) in zip(report.failed.values(), FAULTS.values(), strict=True):
        assert words in sentence
        assert "\n" not in sentence
    assert [path.name for path in (tmp_path / "out").iterdir()] == [f"{NAME}.h5"]


def test_poses_in_another_order_of_children_and_objects_give_the_same_regions(
    root, tmp_path, packed
):
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    for path in (other.scene_folder(0) / "realsense" / "annotations").iterdir():
        objects = path.read_text().split("<obj>")
        lines = [["<obj>", *part.split("</obj>")[0].splitlines()[::-1]] for part in objects[1:]]
        text = "".join("\n".join([*part, "</obj>"]) for part in lines)
        path.write_text(f"<scene>{text}</scene>")
    pack.run(other.root, tmp_path / "out", CONFIG, options=QUIET)
    again = packed_regions.read(tmp_path / "out" / f"{NAME}.h5")
    for name in packed_regions.COLUMNS:
        assert_array_equal(getattr(again, name), getattr(packed, name))


def test_labels_that_are_written_again_are_read_again(root, tmp_path):
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    pack.run(other.root, tmp_path / "a", CONFIG, options=QUIET)
    refine = RefineGraspsConfig(contact_radius=1e-6, num_surface_points=1024)
    refine_grasps.run(other.root, refine, options=BatchOptions(progress=False, overwrite=True))
    pack.run(other.root, tmp_path / "b", CONFIG, options=QUIET)
    before, after = (packed_regions.read(tmp_path / name / f"{NAME}.h5") for name in "ab")
    assert np.count_nonzero(after.affordance) < np.count_nonzero(before.affordance)


@pytest.mark.parametrize("kind", ["mesh", "symmetry"])
def test_affordance_of_another_mesh_or_other_symmetries_is_refused(root, tmp_path, kind):
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    labels = symmetry_labels.read(other.symmetry_path(0))
    if kind == "mesh":
        mesh = read_mesh(other.model_path(0))
        write_mesh(other.model_path(0), Mesh(1.01 * mesh.vertices, mesh.faces))
    else:
        labels = replace(labels, symmetries=labels.symmetries[:1], sources=())
    inputs = {"mesh": digest(other.model_path(0))}
    stamp = make_stamp("annotate-symmetry", {}, inputs=inputs)
    symmetry_labels.write(other.symmetry_path(0), labels, stamp)
    report = pack.run(other.root, tmp_path / "out", CONFIG, options=QUIET)
    assert "000.h5: it was made with another file" in report.failed[NAME]
    assert report.failed[NAME].endswith("run refine-grasps with --overwrite")


def test_a_run_killed_while_it_writes_leaves_whole_files(root, tmp_path):
    other, out = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy")), tmp_path / "out"
    for number in range(1, 30):
        shutil.copytree(other.scene_folder(0), other.scene_folder(number))
    script = (
        "import sys; from pathlib import Path\n"
        "from pipelines import pack; from pipelines.configs import PackConfig\n"
        "pack.run(Path(sys.argv[1]), Path(sys.argv[2]), PackConfig(2048, 100))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(other.root), str(out)], stderr=subprocess.DEVNULL
    )
    done = 0
    while process.poll() is None and not (done and list(out.glob(".*"))) and done < 5:
        done = len(list(out.glob("scene*")))
        time.sleep(0.0005)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    files = list(out.glob("scene_*.h5"))
    assert 0 < len(files) < 30
    for path in files:
        assert len(packed_regions.read(path)) > 0
    reader = PackedReader(out)
    assert reader[len(reader) - 1].points.shape == (2048, 3)
    report = pack.run(other.root, out, PackConfig(2048, 100), options=QUIET)
    assert report.skipped == [path.stem for path in sorted(files)]
    assert len(report.done) == 30 - len(files)
    assert len(PackedReader(out)) == 30 * len(packed_regions.read(files[0]))
