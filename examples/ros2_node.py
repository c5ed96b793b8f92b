"""A ROS 2 node: `color`, `depth`, `camera_info` in; `grasps`, `widths` and `openings` out.

    python ros2_node.py --ros-args -p gripper:=franka -r color:=/camera/color/image_raw ...

Images are rectified, depth registered to colour. Grasps are poses of the gripper's base (z
approach, y closing) in the frame of the depth image, best first, without those not worth trying;
widths and openings are metres, in the same order.
"""

from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from message_filters import ApproximateTimeSynchronizer, Subscriber
from numpy.typing import NDArray
from rclpy.qos import qos_profile_sensor_data
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from symgrasp import GraspDetector, SymgraspError

DEPTHS = {"16UC1": "u2", "32FC1": "f4"}  # millimetres and metres
RGB, BGR = slice(3), slice(2, None, -1)  # without a fourth channel
COLORS = {"rgb8": RGB, "rgba8": RGB, "bgr8": BGR, "bgra8": BGR}


def array_of(image: Any) -> NDArray[Any]:
    """Return the pixels of an Image: (H, W) depth in the encoding's unit, or (H, W, 3) RGB."""
    encoding, known = image.encoding, (*DEPTHS, *COLORS)
    if encoding not in known:
        raise SymgraspError(f"{encoding} images are not read; publish {', '.join(known)}")
    numbers = np.dtype((">" if image.is_bigendian else "<") + DEPTHS.get(encoding, "u1"))
    channels = 1 if encoding in DEPTHS else len(encoding) - 1  # a letter each
    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)  # may be padded
    pixels = np.ascontiguousarray(rows[:, : image.width * channels * numbers.itemsize])
    if encoding in DEPTHS:
        return pixels.view(numbers)
    return pixels.reshape(image.height, image.width, channels)[:, :, COLORS[encoding]]


def matrix_of(camera: Any) -> NDArray[np.float64]:
    """Return the (3, 3) camera matrix of rectified images: of P, or of K without a P."""
    projection = np.reshape(camera.p, (3, 4))[:, :3]
    return projection if projection.any() else np.reshape(camera.k, (3, 3))


def pose_of(matrix: NDArray[np.float64]) -> Any:
    """Return the (4, 4) pose `matrix` as a Pose."""
    place = dict(zip("xyz", matrix[:3, 3].tolist(), strict=True))
    turn = dict(zip("xyzw", Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist(), strict=True))
    return Pose(position=Point(**place), orientation=Quaternion(**turn))


def answer(node: Any, detector: GraspDetector) -> None:
    """Make `node` publish the grasps of each set of synchronised images."""
    poses = node.create_publisher(PoseArray, "grasps", 1)
    widths = node.create_publisher(Float32MultiArray, "widths", 1)
    openings = node.create_publisher(Float32MultiArray, "openings", 1)

    def publish(color: Any, depth: Any, camera: Any) -> None:
        try:
            every = detector(array_of(color), array_of(depth), matrix_of(camera))
        except SymgraspError as error:
            node.get_logger().warning(str(error))
            return
        grasps = every[every.worth_trying]
        found = [pose_of(pose) for pose in grasps.poses()]
        poses.publish(PoseArray(header=depth.header, poses=found))
        widths.publish(Float32MultiArray(data=grasps.width.tolist()))
        openings.publish(Float32MultiArray(data=grasps.opening.tolist()))

    topics = (Image, "color"), (Image, "depth"), (CameraInfo, "camera_info")
    subscribed = [Subscriber(node, *t, qos_profile=qos_profile_sensor_data) for t in topics]
    ApproximateTimeSynchronizer(subscribed, 2, slop=0.05).registerCallback(publish)


def main() -> None:
    """Run the node until it is shut down."""
    rclpy.init()
    node = rclpy.create_node("symgrasp")
    answer(node, GraspDetector(node.declare_parameter("gripper", "rg2").value))
    rclpy.spin(node)


if __name__ == "__main__":
    main()
