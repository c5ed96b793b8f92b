"""Grasps of a camera, frame by frame: prints the best grasp of each frame, if worth trying.

    pip install pyrealsense2
    python camera_loop.py --gripper franka

`realsense_frames` is one source of frames. Any other iterator of `CameraFrame` can replace it.
"""

import argparse
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symgrasp import GraspDetector, Grasps, SymgraspError


class CameraFrame(NamedTuple):
    """One frame; depth is registered to colour."""

    color: NDArray[np.uint8]  # (H, W, 3) RGB
    depth: NDArray[Any]  # (H, W) metres, 0 or nan = missing
    intrinsics: Mapping[str, Any]  # of both images, with the keys of a camera file


def realsense_frames(width: int = 848, height: int = 480, rate: int = 30) -> Iterator[CameraFrame]:
    """Yield the frames of the first RealSense camera, depth aligned to colour."""
    import pyrealsense2 as rs  # noqa: PLC0415 - other cameras do not need it

    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, rate)
    config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate)
    device = pipeline.start(config).get_device()
    metres = device.first_depth_sensor().get_depth_scale()  # metres of one unit of depth
    align = rs.align(rs.stream.color)
    try:
        while True:
            frames = align.process(pipeline.wait_for_frames())
            color, depth = frames.get_color_frame(), frames.get_depth_frame()
            lens = color.profile.as_video_stream_profile().get_intrinsics()
            names = ("width", "height", "fx", "fy", "ppx", "ppy")
            facts = {name: getattr(lens, name) for name in names}
            facts |= {"coeffs": list(lens.coeffs), "model": str(lens.model)}  # lens distortion
            image, distances = np.array(color.get_data()), np.asarray(depth.get_data()) * metres
            yield CameraFrame(image, distances, facts)
    finally:
        pipeline.stop()


def found(frames: Iterable[CameraFrame], detector: GraspDetector) -> Iterator[Grasps]:
    """Yield the grasps of each frame; unusable frames are reported and skipped."""
    for frame in frames:
        try:
            yield detector(*frame)
        except SymgraspError as error:
            print(f"skipped: {error}")


def main(arguments: list[str] | None = None) -> None:
    """Print the best grasp of each frame until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gripper", default="rg2")
    detector = GraspDetector(parser.parse_args(arguments).gripper)
    for grasps in found(realsense_frames(), detector):
        if not grasps:
            print(grasps.message)
            continue
        if not grasps.best.worth_trying:
            print(f"{len(grasps)} grasps, none worth trying: move the camera")
            continue
        x, y, z = grasps.best.pose()[:3, 3]
        print(f"{len(grasps)} grasps; best: base at {x:.3f} {y:.3f} {z:.3f} m")


if __name__ == "__main__":
    main()
