"""Digests of a scene's frames: images by their sizes, poses by content."""

import shutil

import cv2
import numpy as np
import pytest

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.scene_digests import digest_of_frames
from tests.stages.toy_root import write_root


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("root"))


@pytest.fixture
def copied(original, tmp_path):
    shutil.copytree(original.root, tmp_path / "copy")
    return GraspNetRoot(tmp_path / "copy")


def other_picture(folder):
    path = folder / "depth/0001.png"
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    noise = np.random.default_rng(0).integers(0, 3, depth.shape, np.uint16)
    cv2.imwrite(str(path), depth + noise)


def other_pose(folder):
    path = next(folder.glob("annotations/0001.xml"))
    text = path.read_text()
    digit = next(i for i, c in enumerate(text) if c.isdigit() and text[i - 1] == ".")
    path.write_text(text[:digit] + str((int(text[digit]) + 1) % 10) + text[digit + 1 :])


def other_camera(folder):
    path = folder / "camK.npy"
    np.save(path, np.load(path, allow_pickle=False) * 1.01)


def frame_less(folder):
    for path in folder.glob("*/0001.*"):
        path.unlink()


def label_less(folder):
    (folder / "label/0000.png").unlink()


CHANGES = [other_picture, other_pose, other_camera, frame_less, label_less]


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_frames_changes_their_digest(original, copied, change):
    before = digest_of_frames(original.scenes()[0])
    assert digest_of_frames(copied.scenes()[0]) == before
    change(copied.scenes()[0].camera_folder)
    assert digest_of_frames(copied.scenes()[0]) != before


def test_hidden_files_do_not_change_the_digest(copied):
    scene = copied.scenes()[0]
    before = digest_of_frames(scene)
    (scene.camera_folder / "rgb/._0000.png").write_bytes(b"resource fork")
    assert digest_of_frames(scene) == before
