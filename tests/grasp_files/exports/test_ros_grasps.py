"""JSON with the field names of ROS messages."""

import json

import numpy as np
import pytest

from pipelines.grasp_files.exports import ros_grasps
from tests.grasp_files.exports.gripper_toys import random_frame


def test_the_pose_array_has_the_messages_fields(tmp_path):
    typesys = pytest.importorskip("rosbags.typesys", reason="knows the messages of ROS")
    frame, header = random_frame(np.random.default_rng(0), 3, name="x")
    ros_grasps.write_frame(tmp_path / "x.json", frame, header)
    found = json.loads((tmp_path / "x.json").read_text())["pose_array"]
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).types
    pose, point = types["geometry_msgs/msg/Pose"], types["geometry_msgs/msg/Point"]
    quaternion = types["geometry_msgs/msg/Quaternion"]
    head, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    stamp = time(**found["header"].pop("stamp"))
    message = types["geometry_msgs/msg/PoseArray"](
        header=head(stamp=stamp, **found.pop("header")),
        poses=[
            pose(point(**each["position"]), quaternion(**each["orientation"]))
            for each in found.pop("poses")
        ],
    )
    assert found == {}
    assert len(message.poses) == 3
    assert message.header.frame_id == "camera_color_optical_frame"


@pytest.mark.parametrize(
    ("name", "sec", "nanosec"),
    [
        ("rgb/1305031102.175304", 1305031102, 175304000),
        ("cam/1700000000123456789", 1700000000, 123456789),
        ("1700000000123", 1700000000, 123000000),
        ("01305031102175304000", 1305031102, 175304000),
        ("bag/01305031102175304000-01305031102175304001-0", 1305031102, 175304000),
        ("0000000000123", 0, 0),
        ("0000000012.5", 0, 0),
        ("scenes/scene_0100/realsense/0000", 0, 0),
        ("1305031102.175304/000001", 0, 0),
        ("20240131_123456", 0, 0),
        ("part-4123456789012", 0, 0),  # beyond an int32
        ("9123456789.5", 0, 0),
    ],
)
def test_the_stamp_is_the_time_in_a_frames_name(name, sec, nanosec):
    assert ros_grasps.time_of(name) == {"sec": sec, "nanosec": nanosec}
