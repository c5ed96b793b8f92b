"""A whole root in GraspNet-1Billion's layout, written and read."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.dataset import object_list
from pipelines.dataset.graspnet import graspnet, graspnet_layout
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import FormatError, SymgraspError, UnknownNameError
from pipelines.frames import graspnet_scene
from pipelines.frames.frames import find_frames
from pipelines.frames.graspnet_scene import ObjectPose
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.storage.array_files import write_npy
from pipelines.storage.images import write_image
from pipelines.storage.provenance import make_stamp

CAMERA = Intrinsics(60.0, 61.0, 31.5, 23.5, 64, 48)
DEPTH = np.random.default_rng(0).uniform(0.4, 0.8, (48, 64))


@pytest.fixture
def root(tmp_path: Path) -> GraspNetRoot:
    """Two scenes, one camera, three frames: far less than the original's 190 x 2 x 256."""
    rng = np.random.default_rng(1)
    dataset = GraspNetRoot(tmp_path)
    for scene_id in (0, 130):
        folder = dataset.scene_folder(scene_id)
        graspnet_scene.write_object_ids(folder / "object_id_list.txt", [5, 2])
        camera = folder / "realsense"
        write_npy(camera / "camK.npy", CAMERA.matrix)
        graspnet_scene.write_pose_array(camera / "camera_poses.npy", np.tile(np.eye(4), (3, 1, 1)))
        graspnet_scene.write_pose_array(camera / "cam0_wrt_table.npy", np.eye(4))
        for frame_id in range(3):
            frame = graspnet_layout.FrameFiles(camera, scene_id, "realsense", frame_id)
            poses = [ObjectPose(i, make_pose(random_rotation(rng), rng.random(3))) for i in (5, 2)]
            write_image(frame.path("rgb"), np.full((48, 64, 3), frame_id, np.uint8))
            graspnet.write_depth(frame.path("depth"), DEPTH)
            graspnet.write_label(frame.path("label"), np.full((48, 64), 6))
            graspnet_scene.write_annotation(frame.path("annotations"), poses)
            graspnet_scene.write_meta(frame.path("meta"), poses, CAMERA.matrix)
    (tmp_path / "models/005").mkdir(parents=True)
    (tmp_path / "models/notes").mkdir()
    return dataset


def test_the_content_of_the_root_is_listed(root: GraspNetRoot) -> None:
    assert root.object_ids() == [5]
    assert root.scene_ids() == [0, 130]
    assert root.scene_ids("similar") == [130]
    assert root.cameras(0) == ["realsense"]
    scene = root.scene(130)
    assert scene.object_ids == [5, 2]
    assert scene.frame_ids == [0, 1, 2]
    assert scene.intrinsics == CAMERA
    assert scene.camera_poses.shape == (3, 4, 4)
    assert [s.scene_id for s in root.scenes("realsense")] == [0, 130]
    assert root.scenes("kinect") == []


def test_files_have_the_names_of_the_original_dataset(root: GraspNetRoot) -> None:
    base = root.root
    assert root.model_path(5) == base / "models/005/nontextured.ply"
    assert root.grasp_label_path(5) == base / "grasp_label/005_labels.npz"
    collision = base / "collision_label/scene_0130/collision_labels.npz"
    assert root.collision_label_path(130) == collision
    frame = root.scene(0).frame(2)
    folder = base / "scenes/scene_0000/realsense"
    assert frame.path("annotations") == folder / "annotations/0002.xml"
    assert frame.path("rect") == folder / "rect/0002.npy"
    assert all(frame.path(k).is_file() for k in ("rgb", "depth", "label", "meta", "annotations"))


def test_depth_is_sixteen_bit_millimetres(root: GraspNetRoot) -> None:
    stored = cv2.imread(str(root.scene(0).frame(0).path("depth")), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert_array_equal(stored, np.rint(DEPTH * 1000))


def test_depth_that_sixteen_bits_cannot_hold_is_stored_as_missing(tmp_path: Path) -> None:
    metres = np.array([[np.nan, np.inf, -1.0, 0.0, 66.0, 0.5]])
    graspnet.write_depth(tmp_path / "d.png", metres)
    stored = cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED)
    assert stored.tolist() == [[0, 0, 0, 0, 0, 500]]


def test_a_frame_reads_as_it_was_written(root: GraspNetRoot) -> None:
    files = root.scene(0).frame(1)
    frame = root.read_frame(files)
    assert frame.name == "scenes/scene_0000/realsense/0001"
    assert frame.intrinsics == CAMERA
    assert_allclose(frame.depth, DEPTH, atol=5.1e-4)
    assert frame.color.max() == 1
    assert root.read_label(files).max() == 6
    assert [pose.object_id for pose in root.read_annotation(files)] == [5, 2]


@pytest.mark.parametrize("metres", [0.03, 0.135, 9.0])
def test_the_unit_of_a_root_is_known_and_never_guessed_from_depth(
    root: GraspNetRoot, metres: float
) -> None:
    files = root.scene(0).frame(1)
    graspnet.write_depth(files.path("depth"), np.full(DEPTH.shape, metres))
    assert_allclose(root.read_frame(files).depth, metres, rtol=1e-5)
    assert_allclose(root.read_depth(files)[0], metres, rtol=1e-5)


def test_infer_finds_the_same_frames_under_the_same_names(root: GraspNetRoot) -> None:
    sources = find_frames(root.root)
    names = [frame.name for scene in root.scenes() for frame in scene.frames()]
    assert [source.name for source in sources] == names
    assert_array_equal(sources[4].read().depth, root.read_frame(root.frame(names[4])).depth)


@pytest.mark.parametrize("prefix", ["", "scenes/", "anything/scenes/"])
def test_frames_are_known_by_the_end_of_their_name(root: GraspNetRoot, prefix: str) -> None:
    assert root.frame(f"{prefix}scene_0130/realsense/0002") == root.scene(130).frame(2)
    assert graspnet_layout.frame_key("mosd/learn6") is None
    with pytest.raises(SymgraspError, match="learn6"):
        root.frame("mosd/learn6")


def test_missing_parts_are_reported_in_one_sentence(root: GraspNetRoot) -> None:
    with pytest.raises(SymgraspError, match="scene_0007 has no folder kinect or realsense"):
        root.scene(7)
    with pytest.raises(UnknownNameError, match="kinect"):
        root.scene(0, "kinect")
    with pytest.raises(UnknownNameError, match="unseen"):
        root.scene_ids("unseen")
    with pytest.raises(SymgraspError, match=r"models does not exist; .*GraspNet-1B"):
        GraspNetRoot(root.root / "none").object_ids()


@pytest.mark.parametrize("camera", [None, "realsense"])
def test_a_scene_without_cameras_is_left_out_with_a_warning(
    root: GraspNetRoot, camera: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    (root.scene_folder(0) / "realsense").rename(root.root / "lost")
    assert [scene.scene_id for scene in root.chosen_scenes(camera, None)] == [130]
    assert caplog.messages == [
        f"{root.scene_folder(0)} has no folder kinect or realsense, so it is left out"
    ]


def test_objects_without_a_model_are_named_in_a_warning(
    root: GraspNetRoot, caplog: pytest.LogCaptureFixture
) -> None:
    record = ObjectRecord(12, "12", "mug")
    object_list.write(root.root / "objects.json", [record], make_stamp("toy", {}))
    assert root.checked_object_ids() == [5]
    assert caplog.messages == [
        f"{root.root / 'models'} lacks objects that objects.json or scenes name: 002, 012; they "
        "are left out"
    ]
    caplog.clear()
    for name in ("002", "012"):
        (root.root / "models" / name).mkdir()
    assert root.checked_object_ids() == [2, 5, 12]
    assert not caplog.messages


def test_a_damaged_list_of_objects_does_not_hide_the_others(
    root: GraspNetRoot, caplog: pytest.LogCaptureFixture
) -> None:
    (root.root / "objects.json").write_text("{")
    (root.scene_folder(0) / "object_id_list.txt").write_text("x")
    assert root.checked_object_ids() == [5]
    assert "name: 002; they" in caplog.text


def test_a_colour_picture_is_refused_as_label(root: GraspNetRoot) -> None:
    frame = root.scene(0).frame(0)
    write_image(frame.path("label"), np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(FormatError, match="channel"):
        root.read_label(frame)


def test_every_scene_has_one_split() -> None:
    splits = [graspnet_layout.split_of_scene(scene) for scene in range(190)]
    assert [splits.count(name) for name in graspnet_layout.SPLITS] == [100, 30, 30, 30]
    for lost in (190, 1190):
        with pytest.raises(SymgraspError, match=str(lost)):
            graspnet_layout.split_of_scene(lost)


def test_splits_go_on_a_thousand_above() -> None:
    novel = graspnet_layout.scenes_of_split("novel")
    assert novel[:30] == list(range(160, 190))
    assert novel[30:32] == [1160, 1161]
    assert {graspnet_layout.split_of_scene(scene) for scene in novel} == {"novel"}
    assert max(graspnet_layout.scenes_of_split("train")) <= 9999  # scene_NNNN


@pytest.mark.parametrize(("largest", "bits"), [(254, np.uint8), (255, np.uint16)])
def test_labels_have_as_many_bits_as_their_ids_need(
    root: GraspNetRoot, largest: int, bits: type
) -> None:
    frame, label = root.scene(0).frame(1), np.arange(48 * 64).reshape(48, 64) % (largest + 2)
    graspnet.write_label(frame.path("label"), label)
    read = root.read_label(frame)
    assert read.dtype == bits
    np.testing.assert_array_equal(read, label)


def test_depth_read_alone_equals_the_depth_of_the_frame(root: GraspNetRoot) -> None:
    files = root.scene(0).frame(1)
    files.path("rgb").unlink()
    depth, intrinsics = root.read_depth(files)
    assert_allclose(depth, DEPTH, atol=5.1e-4)
    assert intrinsics == CAMERA


def test_a_frame_without_a_camera_pose_is_reported_in_one_sentence(root: GraspNetRoot) -> None:
    scene = root.scene(0)
    assert_array_equal(scene.table_from_camera(2), np.eye(4))
    with pytest.raises(FormatError, match="frame 3 has none"):
        scene.table_from_camera(3)
    graspnet_scene.write_pose_array(scene.camera_folder / "camera_poses.npy", np.eye(4))
    with pytest.raises(FormatError, match=r"\(n, 4, 4\)"):
        scene.table_from_camera(0)
