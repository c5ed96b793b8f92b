"""Annotations, meta files and the other small files of a scene."""

import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames import graspnet_scene as scene
from pipelines.frames.graspnet_scene import ObjectPose
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.grasping.grasps import GraspPoses

K = np.array([[900.0, 0.0, 640.0], [0.0, 901.0, 360.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def poses() -> list[ObjectPose]:
    rng = np.random.default_rng(0)
    return [ObjectPose(i, make_pose(random_rotation(rng), rng.normal(size=3))) for i in (14, 2, 70)]


def test_the_xml_has_its_children_in_the_order_of_the_original(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    scene.write_annotation(tmp_path / "0000.xml", poses)
    text = (tmp_path / "0000.xml").read_text()
    assert text.startswith(
        '<?xml version="1.0" ?>\n<scene>\n    <obj>\n        <obj_id>14</obj_id>'
    )
    assert not any(not line.strip() for line in text.splitlines())
    # The original reads children 0 to 4 by position, whatever their tags.
    for element, pose in zip(ElementTree.fromstring(text), poses, strict=True):
        assert int(element[0].text or "") == pose.object_id
        position = [float(word) for word in (element[3].text or "").split()]
        assert_allclose(position, pose.T_cam_obj[:3, 3], atol=5.1e-5)
        assert all(len(word.split(".")[1]) == 4 for word in (element[4].text or "").split())


def test_xml_poses_are_read_back_within_four_decimals(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    scene.write_annotation(tmp_path / "0000.xml", poses)
    for read, pose in zip(scene.read_annotation_xml(tmp_path / "0000.xml"), poses, strict=True):
        assert read.object_id == pose.object_id
        assert_allclose(read.T_cam_obj, pose.T_cam_obj, atol=3e-4)
        assert_allclose(np.linalg.det(read.T_cam_obj), 1.0)


def rewritten(path: Path, change: Callable[[ElementTree.Element], object]) -> None:
    root = ElementTree.fromstring(path.read_text())
    change(root)
    path.write_text(ElementTree.tostring(root, encoding="unicode"))


def test_children_in_another_order_are_read_by_their_tags(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    path = tmp_path / "0000.xml"
    scene.write_annotation(path, poses)
    before = scene.read_annotation_xml(path)

    def shuffle(root: ElementTree.Element) -> None:
        rng = np.random.default_rng(0)
        for element in root:
            children = list(element)
            element[:] = [children[i] for i in rng.permutation(len(children))]
            ElementTree.SubElement(element, "note").text = "by hand"

    rewritten(path, shuffle)
    for read, known in zip(scene.read_annotation_xml(path), before, strict=True):
        assert read.object_id == known.object_id
        assert read.name == known.name
        assert_array_equal(read.T_cam_obj, known.T_cam_obj)


def test_objects_in_another_order_keep_their_poses(tmp_path: Path, poses: list[ObjectPose]) -> None:
    scene.write_annotation(tmp_path / "a.xml", poses[::-1])
    scene.write_meta(tmp_path / "a.mat", poses, K)
    read = scene.read_poses(tmp_path / "a.xml", tmp_path / "a.mat")
    assert [pose.object_id for pose in read] == [70, 2, 14]
    for pose, known in zip(read, poses[::-1], strict=True):
        assert_allclose(pose.T_cam_obj, known.T_cam_obj, atol=1e-6)


@pytest.mark.parametrize(
    ("tag", "text", "sentence"),
    [
        ("pos_in_world", None, "lacks pos_in_world"),
        ("obj_id", None, "lacks obj_id"),
        ("obj_id", "70", "lists object 70 twice"),
        ("pos_in_world", "1 2", "not numeric"),
        ("pos_in_world", "1 nan 2", "no rigid transform"),
        ("ori_in_world", "0 0 0 0", "no rigid transform"),
        ("ori_in_world", "0.9 0.2 0.4 0.4", "no rigid transform"),
        ("ori_in_world", "nan 0 0 1", "no rigid transform"),
    ],
)
def test_a_wrong_pose_is_reported_in_one_sentence(
    tmp_path: Path, poses: list[ObjectPose], tag: str, text: str | None, sentence: str
) -> None:
    path = tmp_path / "0003.xml"
    scene.write_annotation(path, poses)

    def spoil(root: ElementTree.Element) -> None:
        child = root[0].find(tag)
        assert child is not None
        child.text = text
        if text is None:
            root[0].remove(child)

    rewritten(path, spoil)
    with pytest.raises(FormatError, match=sentence) as error:
        scene.read_annotation_xml(path)
    assert "0003.xml" in str(error.value)


@pytest.mark.parametrize(
    "text", ["<scene><obj>", "", "<scene><obj><obj_id>x</obj_id></obj></scene>"]
)
def test_a_damaged_xml_is_reported_in_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "0000.xml").write_text(text)
    with pytest.raises(FormatError, match=r"0000\.xml"):
        scene.read_annotation_xml(tmp_path / "0000.xml")


def test_entities_in_an_xml_are_refused(tmp_path: Path) -> None:
    bomb = '<!DOCTYPE s [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><scene>&b;</scene>'
    (tmp_path / "0000.xml").write_text(bomb)
    with pytest.raises(SymgraspError):
        scene.read_annotation_xml(tmp_path / "0000.xml")


def test_meta_has_the_originals_names_types_and_one_based_ids(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    scene.write_meta(tmp_path / "0000.mat", poses, K)
    content = scipy.io.loadmat(tmp_path / "0000.mat")
    assert content["poses"].dtype == np.float32
    assert content["poses"].shape == (3, 4, 3)
    assert_array_equal(content["cls_indexes"], [[15, 3, 71]])
    assert_array_equal(content["intrinsic_matrix"], K)
    assert_array_equal(content["factor_depth"], [[1000.0]])


def test_meta_bytes_do_not_depend_on_the_time(tmp_path: Path, poses: list[ObjectPose]) -> None:
    scene.write_meta(tmp_path / "0000.mat", poses, K)
    first = (tmp_path / "0000.mat").read_bytes()
    time.sleep(1.05)
    scene.write_meta(tmp_path / "0000.mat", poses, K)
    assert (tmp_path / "0000.mat").read_bytes() == first


@pytest.mark.parametrize("count", [0, 1, 3])
def test_meta_poses_are_read_back_in_float32(
    tmp_path: Path, poses: list[ObjectPose], count: int
) -> None:
    scene.write_meta(tmp_path / "0000.mat", poses[:count], K)
    meta = scene.read_meta(tmp_path / "0000.mat")
    assert meta.object_ids == (14, 2, 70)[:count]
    assert meta.poses is not None
    expected = np.array([p.T_cam_obj for p in poses[:count]]).reshape(-1, 4, 4)
    assert_allclose(meta.poses, expected, atol=1e-6)


@pytest.mark.parametrize("number", [np.nan, np.inf, -1.0])
def test_wrong_meta_poses_are_read_back_unchanged(
    tmp_path: Path, poses: list[ObjectPose], number: float
) -> None:
    spoilt = [ObjectPose(p.object_id, p.T_cam_obj.astype(np.float32)) for p in poses]
    spoilt[1].T_cam_obj[:2, :3] = number
    scene.write_meta(tmp_path / "0000.mat", spoilt, K)
    read = scene.read_meta(tmp_path / "0000.mat").poses
    assert_array_equal(read, np.stack([p.T_cam_obj for p in spoilt]))


def test_a_truncated_mat_is_reported_in_one_sentence(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    path = tmp_path / "0000.mat"
    scene.write_meta(path, poses, K)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(FormatError, match=r"0000\.mat"):
        scene.read_meta(path)


def test_poses_take_the_digits_of_the_mat_where_both_files_agree(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    scene.write_annotation(tmp_path / "a.xml", poses)
    scene.write_meta(tmp_path / "a.mat", poses, K)
    for read, pose in zip(
        scene.read_poses(tmp_path / "a.xml", tmp_path / "a.mat"), poses, strict=True
    ):
        assert_allclose(read.T_cam_obj, pose.T_cam_obj, atol=1e-6)


@pytest.mark.parametrize("stale", ["moved", "damaged", "other objects", "absent"])
def test_poses_come_from_the_xml_where_the_mat_is_stale(
    tmp_path: Path, poses: list[ObjectPose], stale: str
) -> None:
    scene.write_annotation(tmp_path / "a.xml", poses)
    if stale == "moved":
        moved = [ObjectPose(p.object_id, p.T_cam_obj + 0.01) for p in poses]
        scene.write_meta(tmp_path / "a.mat", moved, K)
    elif stale == "damaged":
        damaged = ObjectPose(poses[-1].object_id, np.full((4, 4), np.nan))
        scene.write_meta(tmp_path / "a.mat", [*poses[:-1], damaged], K)
    elif stale == "other objects":
        scene.write_meta(tmp_path / "a.mat", poses[:2], K)
    read = scene.read_poses(tmp_path / "a.xml", tmp_path / "a.mat")
    assert [p.object_id for p in read] == [14, 2, 70]
    for found, pose in zip(read, poses, strict=True):
        assert_allclose(found.T_cam_obj, pose.T_cam_obj, atol=3e-4)


def test_object_ids_are_one_a_line(tmp_path: Path) -> None:
    scene.write_object_ids(tmp_path / "object_id_list.txt", [14, 2, 70])
    assert (tmp_path / "object_id_list.txt").read_text() == "14\n2\n70\n"
    assert scene.read_object_ids(tmp_path / "object_id_list.txt") == [14, 2, 70]


@pytest.mark.parametrize("line", [b"banana", b"\xc6", b"9" * 5000, "\u00b2".encode(), b"-1"])
def test_a_line_without_an_object_id_is_refused(tmp_path: Path, line: bytes) -> None:
    (tmp_path / "object_id_list.txt").write_bytes(b"14\n" + line)
    with pytest.raises(FormatError, match="object id"):
        scene.read_object_ids(tmp_path / "object_id_list.txt")


def test_pose_arrays_must_be_transforms(tmp_path: Path) -> None:
    scene.write_pose_array(tmp_path / "camera_poses.npy", np.tile(np.eye(4), (5, 1, 1)))
    assert scene.read_pose_array(tmp_path / "camera_poses.npy", 3).shape == (5, 4, 4)
    np.save(tmp_path / "bad.npy", np.zeros((5, 3)))
    with pytest.raises(FormatError, match=r"\(5, 3\)"):
        scene.read_pose_array(tmp_path / "bad.npy", 2)


def test_rotations_of_few_decimals_are_made_exact_and_exact_ones_stay(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    exact = np.stack([pose.T_cam_obj for pose in poses])
    for name, stored in (("few", exact.round(2)), ("single", exact.astype(np.float32))):
        scene.write_pose_array(tmp_path / f"{name}.npy", stored)
        scene.write_pose_array(tmp_path / f"{name}_one.npy", stored[1])
    few = scene.read_pose_array(tmp_path / "few.npy", 3)
    assert_allclose(few, exact, atol=0.02)
    assert_array_equal(few[:, :3, 3], exact[:, :3, 3].round(2))
    assert_array_equal(scene.read_pose_array(tmp_path / "few_one.npy", 2), few[1])
    hand = GraspPoses(np.eye(3), np.zeros(3), np.array(0.05))
    for T in few:
        hand.transformed(T)  # otherwise refused as no rotation
    single = scene.read_pose_array(tmp_path / "single.npy", 3)
    assert_array_equal(single, exact.astype(np.float32))
    assert_array_equal(scene.read_pose_array(tmp_path / "single_one.npy", 2), single[1])


def test_poses_of_few_decimals_in_a_mat_are_made_exact_and_exact_ones_stay(
    tmp_path: Path, poses: list[ObjectPose]
) -> None:
    exact = np.stack([pose.T_cam_obj for pose in poses])
    few = [ObjectPose(p.object_id, p.T_cam_obj.round(3)) for p in poses]
    scene.write_meta(tmp_path / "few.mat", few, K)
    scene.write_meta(tmp_path / "single.mat", poses, K)
    read = scene.read_meta(tmp_path / "few.mat").poses
    assert read is not None
    assert_allclose(read, exact, atol=0.002)
    GraspPoses(read[:, :3, :3], read[:, :3, 3], np.ones(3))
    assert_array_equal(scene.read_meta(tmp_path / "single.mat").poses, exact.astype(np.float32))


@pytest.mark.parametrize(("shape", "ndim"), [((4, 4), 3), ((5, 4, 4), 2), ((5, 3, 4), 3)])
def test_pose_arrays_of_another_shape_are_refused(
    tmp_path: Path, shape: tuple[int, ...], ndim: int
) -> None:
    np.save(tmp_path / "camera_poses.npy", np.zeros(shape))
    with pytest.raises(FormatError, match=r"an array of shape .* is expected"):
        scene.read_pose_array(tmp_path / "camera_poses.npy", ndim)


@pytest.mark.parametrize("fault", ["scaled", "sheared", "mirrored", "nan", "last row", "objects"])
def test_matrices_that_are_not_rigid_are_refused(tmp_path: Path, fault: str) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    match fault:
        case "scaled":
            poses[1, :3, :3] *= 1.1
        case "sheared":
            poses[1, 0, 1] = 0.1
        case "mirrored":
            poses[1, 0, 0] = -1.0
        case "nan":
            poses[1, 2, 3] = np.nan
        case "last row":
            poses[1, 3, 3] = 1000.0
    stored = np.array([None], object) if fault == "objects" else poses
    np.save(tmp_path / "camera_poses.npy", stored, allow_pickle=True)
    with pytest.raises(FormatError, match=r"rigid|pickles never"):
        scene.read_pose_array(tmp_path / "camera_poses.npy", 3)
