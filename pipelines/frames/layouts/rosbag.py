"""ROS bags: `.bag`, `.mcap` and `.db3` files, and folders of these with `metadata.yaml`."""

import functools
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_search import where_a_camera_may_be
from pipelines.frames.encodings.ros_bags import (
    Recorded,
    find_cameras,
    open_bag,
    read_camera,
    read_image_at,
    read_stamps,
)
from pipelines.frames.encodings.ros_topics import Topics
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout, refuse
from pipelines.frames.layouts.tum import associate
from pipelines.frames.rgbd import Frame, as_color, make_frame

ROS_2_FILES = ("*.db3", "*.mcap")
# First bytes; other `.db3` files are databases of other programs. Every `.bag` and `.mcap` counts.
MAGIC = {"*.bag": b"", "*.db3": b"SQLite format 3\0", "*.mcap": b""}


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the frames of the bags in `folder`, named after the time of their colour image.

    If a bag has several cameras, the names have a folder for each camera.
    """
    metadata = folder / "metadata.yaml"
    parts = sorted(file for pattern in ROS_2_FILES for file in folder.glob(pattern))
    if parts and metadata.is_file():
        yield from _frames(folder, (*parts, metadata), options)
        return
    lone = (file for pattern in MAGIC for file in folder.glob(pattern) if _is_bag(file))
    for bag in sorted(lone):
        try:
            frames = _frames(bag, (bag,), options)
        except SymgraspError as error:
            frames = [FoundFrame("", functools.partial(refuse, error), (bag,))]
        yield from (replace(each, stem=f"{bag.stem}/{each.stem}") for each in frames)


def _is_bag(file: Path) -> bool:
    if not file.is_file():
        return False
    with file.open("rb") as stream:
        return stream.read(16).startswith(MAGIC[f"*{file.suffix}"])


def _frames(bag: Path, files: tuple[Path, ...], options: FrameOptions) -> list[FoundFrame]:
    with open_bag(bag) as reader:
        cameras, passed_over = find_cameras(bag, reader)
        pairs = [associate(*(read_stamps(reader, t) for t in (c.color, c.depth))) for c in cameras]
    frames = []
    for topics, taken in zip(cameras, pairs, strict=True):
        above = "" if len(cameras) == 1 else f"{topics.name}/"
        if not taken:
            found = f"has no colour and depth images of one time in {topics.color}, {topics.depth}"
            read = functools.partial(refuse, FormatError(bag, found, "record both at once"))
            frames.append(FoundFrame(above, read, files))
        for stem, pair in zip(frame_stems([color for color, _ in taken]), taken, strict=True):
            read = functools.partial(_read, bag, topics, pair, options, tuple(passed_over))
            frames.append(FoundFrame(above + stem, read, files))
    return frames


def frame_stems(images: list[Recorded]) -> list[str]:
    """Return a name for each image: the time of its recording, if no other image has that time.

    Else the time in its header; if other images have that time too, both times and its number.
    """
    times, stamps = (Counter(image[at] for image in images) for at in (0, 1))
    stems = []
    for image in images:
        if times[image.time] == 1:
            stems.append(f"{image.time:020d}")
        elif stamps[image.stamp] == 1 and times[image.stamp] != 1:
            stems.append(f"{image.stamp:020d}")
        else:
            stems.append(f"{image.time:020d}-{image.stamp:020d}-{image.number}")
    return stems


def _read(
    bag: Path,
    topics: Topics,
    pair: tuple[Recorded, Recorded],
    options: FrameOptions,
    notes: tuple[str, ...],
) -> Frame:
    with open_bag(bag) as reader:
        color, depth = (
            read_image_at(bag, reader, topic, which)
            for topic, which in zip((topics.color, topics.depth), pair, strict=True)
        )
        camera = options.camera or read_camera(bag, reader, topics)
    if camera is None:
        found = f"has no CameraInfo next to {topics.depth}"
        raise FormatError(bag, found, where_a_camera_may_be(bag))
    if not topics.is_aligned:
        notes = (f"{topics.depth} is not called aligned: record aligned_depth_to_color", *notes)
    image = (bag, functools.partial(as_color, bag, color))
    return make_frame(image, (bag, depth), camera, options.depth_units(), notes)


LAYOUT = Layout("ROS bag", _find)
