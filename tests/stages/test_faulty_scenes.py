"""Stages that cut frames into regions name faulty scenes, do the others, notice new meshes."""

import shutil

import cv2
import numpy as np
import pytest

from pipelines import export_coco, finetune_detector, pack
from pipelines.configs import (
    DetectorConfig,
    ExportCocoConfig,
    FinetuneDetectorConfig,
    PackConfig,
)
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.training import coco_instances
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.runtime.batch import BatchOptions
from tests.stages.toy_root import SCENES, write_root

QUIET = BatchOptions(progress=False)
DETECTOR = FinetuneDetectorConfig(detector=DetectorConfig(min_size=96, max_size=128), min_pixels=50)
WHOLE = [f"scene_{number:04d}_realsense" for number in SCENES]


def packed(root, out):
    config = PackConfig(num_points=128, min_pixels=50)
    return pack.run(root.root, out, config, split=None, options=QUIET)


def exported(root, out):
    return export_coco.run(root.root, out, ExportCocoConfig(), split=None, options=QUIET)


def prepared(root, out):
    items = finetune_detector.scene_items(root.root, out / "detector.safetensors", DETECTOR)
    return finetune_detector.prepare(root.root, items, DETECTOR, QUIET)


STAGES = [packed, exported, prepared]


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("root"))


@pytest.fixture
def root(original, tmp_path):
    return GraspNetRoot(shutil.copytree(original.root, tmp_path / "root"))


def scaled_label(scale):
    def damage(camera):
        path = str(camera / "label/0001.png")
        label = cv2.imread(path, cv2.IMREAD_UNCHANGED)
        size = (int(320 * scale), int(240 * scale))
        cv2.imwrite(path, cv2.resize(label, size, interpolation=cv2.INTER_NEAREST))

    return damage


def without_pose(camera):
    path = camera / "annotations/0001.xml"
    text = path.read_text()
    path.write_text(text[: text.rindex("<obj>")] + "</scene>")


def unknown_object(camera):
    cv2.imwrite(str(camera / "label/0001.png"), np.full((240, 320), 60, np.uint8))


# A fault of a scene, and words of the error about it.
FAULTS = {
    "a small label": (scaled_label(0.5), "0001.png: the label image is 160x120"),
    "a large label": (scaled_label(2.0), "0001.png: the label image is 640x480"),
    "no pose of an object": (without_pose, "0001.xml: holds no pose of object 2"),
    "an object of no scene": (unknown_object, "0001.png: shows object 59"),
    "no depth image": (lambda c: (c / "depth/0001.png").unlink(), "depth/0001.png does"),
    "no object list": (lambda c: (c.parent / "object_id_list.txt").unlink(), "object_id_list"),
}


@pytest.mark.parametrize("stage", STAGES)
def test_scenes_at_fault_give_one_sentence_each_and_the_rest_is_done(root, tmp_path, stage):
    for number, (damage, _) in enumerate(FAULTS.values(), start=SCENES[0] + 1):
        shutil.copytree(root.scene_folder(SCENES[0]), root.scene_folder(number))
        damage(root.scene_folder(number) / "realsense")
    report = stage(root, tmp_path / "out")
    assert report.done == WHOLE
    assert len(report.failed) == len(FAULTS)
    for sentence, (_, words) in zip(report.failed.values(), FAULTS.values(), strict=True):
        assert words in sentence
        assert "\n" not in sentence


@pytest.mark.parametrize("stage", STAGES)
def test_frames_that_have_only_annotations_are_left_out(root, tmp_path, stage):
    for scene in SCENES:
        folder = root.scene_folder(scene) / "realsense/annotations"
        shutil.copy(folder / "0001.xml", folder / "0007.xml")
    report = stage(root, tmp_path / "out")
    assert (report.failed, sorted(report.done)) == ({}, WHOLE)


@pytest.mark.parametrize("stage", STAGES)
def test_regions_that_were_cut_from_another_mesh_are_not_reused(root, tmp_path, stage):
    assert stage(root, tmp_path / "out").done == WHOLE
    assert stage(root, tmp_path / "out").skipped == WHOLE
    path = root.model_path(0)
    mesh = read_mesh(path)
    write_mesh(path, Mesh(mesh.vertices, mesh.faces[::-1].copy()))
    report = stage(root, tmp_path / "out")
    assert list(report.failed) == WHOLE
    assert all("other settings or inputs" in why for why in report.failed.values())


def test_masks_of_a_coco_dataset_of_another_size_are_reported_in_one_sentence(root, tmp_path):
    exported(root, tmp_path / "coco")
    coco = GraspNetRoot(tmp_path / "coco")
    frame = coco_instances.read_coco_frames(coco.root, "train")[0]
    for kind in ("rgb", "depth"):
        path = str(frame.files.path(kind))
        picture = cv2.imread(path, cv2.IMREAD_UNCHANGED)
        cv2.imwrite(path, cv2.resize(picture, (160, 120), interpolation=cv2.INTER_NEAREST))
    halved = np.array([[150.0, 0.0, 79.5], [0.0, 150.0, 59.5], [0.0, 0.0, 1.0]])
    np.save(frame.files.camera_folder / "camK.npy", halved)
    report = prepared(coco, tmp_path / "out")
    assert list(report.failed) == [frame.scene]
    assert "mask of 320x240; the image is 160x120" in report.failed[frame.scene]
