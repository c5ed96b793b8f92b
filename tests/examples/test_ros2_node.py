"""The ROS 2 node against stand-ins for rclpy and its messages."""

import importlib
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from symgrasp import SymgraspError
from tests.examples import ros_stand_ins
from tests.examples.tabletop_frame import COLOR, DEPTH, LENS, doubtful_detector, light_detector

HEADER = ros_stand_ins.message_type("std_msgs/msg/Header")(frame_id="camera_color_optical_frame")
MILLIMETRES = np.round(DEPTH * 1000).astype(np.uint16)


@pytest.fixture
def node():
    return ros_stand_ins.Node(parameters={"gripper": "franka"})


@pytest.fixture
def example(monkeypatch, node):
    ros_stand_ins.install(monkeypatch, node)
    monkeypatch.delitem(sys.modules, "examples.ros2_node", raising=False)
    return importlib.import_module("examples.ros2_node")


def image(pixels, encoding, padding=0, big=False):
    stored = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
    rows = stored.reshape(len(pixels), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    return ros_stand_ins.message_type("sensor_msgs/msg/Image")(
        header=HEADER,
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=int(big),
        step=rows.shape[1],
        data=rows.tobytes(),
    )


def answering(example, node, detector):
    """Return a function that hands a set of images to the node, as its synchronizer does."""
    example.answer(node, detector)
    return ros_stand_ins.SYNCHRONIZED[-1].deliver


def camera_info(k=LENS, p=(0.0,) * 4):
    """A CameraInfo; `k` and `p` are fx, fy, cx, cy of the images as taken and as rectified."""
    fx, fy, cx, cy = k
    k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    fx, fy, cx, cy = p
    p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, float(fx > 0), 0.0]
    return ros_stand_ins.message_type("sensor_msgs/msg/CameraInfo")(header=HEADER, k=k, p=p)


@pytest.mark.parametrize(
    ("encoding", "stored"),
    [
        ("rgb8", COLOR),
        ("bgr8", COLOR[:, :, ::-1]),
        ("rgba8", np.dstack([COLOR, COLOR[:, :, :1]])),
        ("bgra8", np.dstack([COLOR[:, :, ::-1], COLOR[:, :, :1]])),
    ],
)
def test_colour_of_every_order_of_channels_is_read_as_rgb(example, encoding, stored):
    for padding in (0, 7):
        read = example.array_of(image(np.ascontiguousarray(stored), encoding, padding))
        np.testing.assert_array_equal(read, COLOR)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 3, 8])
def test_depth_is_read_in_the_unit_and_byte_order_of_its_encoding(example, big, padding):
    read = example.array_of(image(MILLIMETRES, "16UC1", padding, big))
    np.testing.assert_array_equal(read, MILLIMETRES)
    metres = DEPTH.astype(np.float32)
    np.testing.assert_array_equal(example.array_of(image(metres, "32FC1", padding, big)), metres)


def test_images_of_an_unknown_encoding_are_refused_in_a_sentence(example):
    with pytest.raises(SymgraspError, match="yuv422 images are not read; publish 16UC1"):
        example.array_of(image(COLOR, "yuv422"))


def test_a_frame_becomes_poses_widths_and_openings_in_the_frame_of_the_depth(example, node):
    detector = light_detector("franka")
    deliver = answering(example, node, detector)
    deliver(image(COLOR, "rgb8"), image(MILLIMETRES, "16UC1"), camera_info())
    expected = detector(COLOR, MILLIMETRES, LENS)
    ((poses,), (widths,), (openings,)) = (
        node.publishers[topic].published for topic in ("grasps", "widths", "openings")
    )
    assert poses.header is HEADER
    assert len(poses.poses) == len(expected) > 0
    for pose, matrix in zip(poses.poses, expected.poses(), strict=True):
        place, turn = pose.position, pose.orientation
        np.testing.assert_allclose([place.x, place.y, place.z], matrix[:3, 3])
        rotation = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        np.testing.assert_allclose(rotation, matrix[:3, :3], atol=1e-12)
    np.testing.assert_allclose(widths.data, expected.width)
    np.testing.assert_allclose(openings.data, expected.opening)
    assert not node.warnings


@pytest.mark.parametrize("sure", [0, 2])
def test_grasps_not_worth_trying_are_not_published(example, node, sure):
    deliver = answering(example, node, doubtful_detector("franka", sure))
    deliver(image(COLOR, "rgb8"), image(MILLIMETRES, "16UC1"), camera_info())
    ((poses,), (widths,), (openings,)) = (
        node.publishers[topic].published for topic in ("grasps", "widths", "openings")
    )
    assert len(poses.poses) == len(widths.data) == len(openings.data) == sure


def test_rectified_images_have_the_camera_of_the_projection_matrix(example, node):
    fx, fy, cx, cy = LENS
    camera = camera_info(k=(1.02 * fx, 1.02 * fy, cx - 3.0, cy + 2.0), p=LENS)
    detector = light_detector("franka")
    deliver = answering(example, node, detector)
    deliver(image(COLOR, "rgb8"), image(MILLIMETRES, "16UC1"), camera)
    (poses,) = node.publishers["grasps"].published
    expected = detector(COLOR, MILLIMETRES, LENS).poses()
    assert len(poses.poses) == len(expected) > 0
    found = [[p.position.x, p.position.y, p.position.z] for p in poses.poses]
    np.testing.assert_allclose(found, expected[:, :3, 3])


def test_a_frame_without_grasps_publishes_none_and_a_wrong_frame_gives_a_warning(example, node):
    deliver = answering(example, node, light_detector())
    bare = image(np.full(DEPTH.shape, 0.8, np.float32), "32FC1")
    deliver(image(COLOR, "rgb8"), bare, camera_info())
    (poses,) = node.publishers["grasps"].published
    assert poses.poses == []
    deliver(image(COLOR, "rgb8"), image(np.zeros_like(MILLIMETRES), "16UC1"), camera_info())
    assert len(node.publishers["grasps"].published) == 1
    assert "every pixel is missing" in node.warnings[0]


def test_the_node_takes_its_gripper_as_a_parameter_and_its_three_topics_together(
    example, node, monkeypatch
):
    grippers = []

    def made(gripper):
        grippers.append(gripper)
        return light_detector(gripper)

    monkeypatch.setattr(example, "GraspDetector", made)
    example.main()
    assert grippers == ["franka"]
    together = ros_stand_ins.SYNCHRONIZED[-1]
    assert together.node is node
    assert together.topics == [
        ("color", "sensor_msgs/msg/Image"),
        ("depth", "sensor_msgs/msg/Image"),
        ("camera_info", "sensor_msgs/msg/CameraInfo"),
    ]
    together.deliver(image(COLOR, "bgr8"), image(MILLIMETRES, "16UC1"), camera_info())
    assert node.publishers["grasps"].published[0].poses
