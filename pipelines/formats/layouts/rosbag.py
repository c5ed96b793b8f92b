"""ROS bags: `.bag` files, and ROS 2 folders of `metadata.yaml` with `.db3` or `.mcap`."""

import functools
from pathlib import Path

import numpy as np

from pipelines.errors import FormatError, SymgraspError
from pipelines.formats.layouts.layout import Layout, frame_name
from pipelines.formats.layouts.tum import associate
from pipelines.formats.rgbd import DepthUnits, Frame, FrameSource, make_frame
from pipelines.formats.rgbd_folder import NO_CAMERA, FrameOptions
from pipelines.formats.ros_bags import (
    Topics,
    find_topics,
    open_bag,
    read_camera,
    read_image_at,
    read_stamps,
)

NAME = "ROS bag"
ROS_2_FILES = ("*.db3", "*.mcap")


def find(folder: Path, prefix: str, options: FrameOptions) -> list[FrameSource]:
    """List the frames of the bags in `folder`, named after the time of their colour image."""
    if (folder / "metadata.yaml").is_file() and any(
        file for pattern in ROS_2_FILES for file in folder.glob(pattern)
    ):
        files = sorted(file for pattern in ROS_2_FILES for file in folder.glob(pattern))
        return _frames(folder, (*files, folder / "metadata.yaml"), folder, prefix, options)
    sources = []
    for bag in sorted(file for file in folder.glob("*.bag") if file.is_file()):
        below = f"{prefix}/{bag.stem}"
        try:
            sources += _frames(bag, (bag,), folder, below, options)
        except SymgraspError as error:
            name = frame_name(folder, below, "")
            sources.append(FrameSource(name, functools.partial(_refuse, error), (bag,), NAME))
    return sources


def _frames(
    bag: Path, files: tuple[Path, ...], folder: Path, prefix: str, options: FrameOptions
) -> list[FrameSource]:
    with open_bag(bag) as reader:
        topics = find_topics(bag, reader)
        pairs = associate(*(read_stamps(reader, topic) for topic in (topics.color, topics.depth)))
    if not pairs:
        found = f"has no colour and depth images of one time in {topics.color} and {topics.depth}"
        raise FormatError(bag, found, "record both at once")
    sources = []
    for color, depth in pairs:
        name = frame_name(folder, prefix, f"{color:020d}")
        read = functools.partial(_read, name, bag, topics, (color, depth), options)
        sources.append(FrameSource(name, read, files, NAME))
    return sources


def _read(
    name: str, bag: Path, topics: Topics, recorded: tuple[int, int], options: FrameOptions
) -> Frame:
    with open_bag(bag) as reader:
        color, depth = (
            read_image_at(bag, reader, topic, time)
            for topic, time in zip((topics.color, topics.depth), recorded, strict=True)
        )
        camera = options.camera
        if camera is None and topics.camera is not None:
            camera = read_camera(bag, reader, topics.camera)
    if camera is None:
        raise FormatError(bag, f"has no CameraInfo beside {topics.depth}", NO_CAMERA)
    notes: tuple[str, ...] = ()
    if not topics.is_aligned:
        notes = (f"{topics.depth} is not called aligned: record aligned_depth_to_color",)
    unit = options.depth_units_per_metre
    units = DepthUnits() if unit is None else DepthUnits(unit, unit)
    image = (bag, lambda: color.astype(np.uint8, copy=False))
    return make_frame(name, image, (bag, depth), camera.at, units, notes)


def _refuse(error: SymgraspError) -> Frame:
    raise error


LAYOUT = Layout(NAME, "ROS bags (*.bag, or metadata.yaml with *.db3 or *.mcap)", find)
