"""Registered RGB-D frames in ROS 1 and ROS 2 bags, with the `rosbags` package (the extra `ros`).

Depth is an image of 16UC1 or mono16 (millimetres, 0 = missing) or 32FC1 (metres, NaN = missing),
as in REP 118; colour is rgb8, bgr8, rgba8 or bgra8; `ros_images` decodes both, also if compressed
by image_transport. The camera is the CameraInfo next to the depth topic, or, for depth that is
aligned to colour, next to the colour topic. `ros_topics` tells the cameras of a bag.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipelines.contents import mapping_in
from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.lens import NO_DISTORTION, distortion_in
from pipelines.frames.encodings.ros_images import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    decode,
    raw_topic,
    shown_by,
)
from pipelines.frames.encodings.ros_topics import (
    Calibration,
    Topics,
    cameras_of_topics,
    is_aligned_depth,
    with_info,
)
from pipelines.frames.encodings.yaml_files import read_yaml
from pipelines.storage.files import existing

IMAGE, CAMERA = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
METADATA = "metadata.yaml"  # of a ROS 2 folder
SQLITE_SIDES = ("-journal", "-wal", "-shm")  # files that SQLite opens next to a database
EXTRA = "install it with `pip install symgrasp[ros]`"


class Recorded(NamedTuple):
    """Identifier of an image in a topic; several may have one time, as from `rosbag` filters."""

    time: int  # nanoseconds, of the recording
    stamp: int  # nanoseconds, of the image's header
    number: int  # among the images of the topic with this time and stamp, from 0


Stamps = list[tuple[float, Recorded]]  # seconds of the image, and its identifier


@contextmanager
def open_bag(path: Path) -> Iterator[Any]:
    """Yield rosbags' reader of a `.bag`, `.mcap` or `.db3` file or a ROS 2 folder.

    Raises:
        FormatError: the bag is damaged, now or while it is read, or names files elsewhere.
        SymgraspError: `rosbags` is not installed, or a part is a pipe or a device.
    """
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise SymgraspError(f"{path} is a ROS bag, which needs rosbags; {EXTRA}") from error
    _check_parts(path)
    try:
        types = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=types) as reader:
            yield reader
    except (SymgraspError, GeneratorExit):
        raise
    except Exception as error:  # its parsers, sqlite and the decompressors raise many kinds
        raise FormatError(
            path, f"this bag is damaged ({error})", "record or copy it again"
        ) from error


def _check_parts(bag: Path) -> None:
    """Refuse a bag with a part that is no plain file: opening a pipe waits without end."""
    for part in _named_parts(bag) if bag.is_dir() else [bag]:
        for each in (part, *(part.with_name(part.name + side) for side in SQLITE_SIDES)):
            if each.exists():
                existing(each)


def _named_parts(folder: Path) -> list[Path]:
    """Return the files that the `metadata.yaml` of a ROS 2 folder names, all in the folder."""
    path = folder / METADATA
    stored = mapping_in(read_yaml(path), "rosbag2_bagfile_information").get("relative_file_paths")
    names = stored if isinstance(stored, list) else []
    for name in names:
        if not isinstance(name, str) or Path(name).name != name:
            raise FormatError(path, f"names the file {name}", "its bag's own files are expected")
    return [folder / name for name in names]


def find_cameras(path: Path, reader: Any) -> tuple[list[Topics], list[str]]:  # noqa: ANN401
    """Return the RGB-D cameras to read, and a sentence on each camera that is passed over.

    All cameras with aligned depth are read, or one camera if there are none.

    Raises:
        FormatError: no topic has an encoding of colour, or none an encoding of depth.
    """
    topics = _images(reader)
    colors, depths, lossy = (
        [topic for topic, kind in topics.items() if kind == wanted]
        for wanted in ("color", "depth", "lossy depth")
    )
    if lossy and not depths:
        found = f"{lossy[0]} holds depth in pictures of 8 bits, from which no distances follow"
        raise FormatError(path, found, "record the raw depth, or compressedDepth of format png")
    if not colors or not depths:
        names = ", ".join(sorted({c.topic for c in reader.connections})) or "none"
        raise FormatError(
            path,
            f"has no {'depth' if colors else 'colour'} images; its topics are {names}",
            f"colour is read as {', '.join(COLOR_ENCODINGS)}, JPEG and PNG, "
            f"depth as {', '.join(DEPTH_ENCODINGS)}, PNG of 16 bits and compressedDepth",
        )
    infos = {c.topic for c in reader.connections if c.msgtype == CAMERA}
    compared = infos if len(colors) > 1 else set()
    stated = {topic: each for topic in compared if (each := _calibration(reader, topic))}
    cameras = [with_info(each, infos) for each in cameras_of_topics(colors, depths, stated)]
    read = [camera for camera in cameras if camera.is_aligned] or cameras[:1]
    return sorted(read, key=lambda camera: camera.name), _passed_over(colors, depths, cameras, read)


def _images(reader: Any) -> dict[str, str]:  # noqa: ANN401 - an extra's
    """Return the kind of each image topic, see `shown_by`; one topic for raw and compressed."""
    kinds: dict[str, tuple[str, str]] = {}
    connections = [c for c in reader.connections if c.msgtype in (IMAGE, COMPRESSED)]
    for topic in sorted({c.topic for c in connections}):
        image = next((image for _t, image in _messages(reader, topic)), None)
        kind = "" if image is None else shown_by(topic, image)
        if kind and kinds.get(raw_topic(topic), ("", ""))[1] != kind:
            kinds.setdefault(raw_topic(topic), (topic, kind))
    return dict(kinds.values())


def _passed_over(
    colors: list[str], depths: list[str], cameras: list[Topics], read: list[Topics]
) -> list[str]:
    """Return a sentence for each topic that may belong to a camera and is not read."""
    others = [camera.depth for camera in cameras if camera not in read]
    sentences = [f"{depth} is passed over: it is not called aligned" for depth in others]
    if set(colors) != {camera.color for camera in read}:
        known = {camera.depth for camera in cameras}
        sentences += [
            f"{depth} is passed over: by the topics' names it belongs to no other camera"
            for depth in depths
            if is_aligned_depth(depth) and depth not in known
        ]
    return sentences + [camera.note for camera in read if camera.rivals]


def read_stamps(reader: Any, topic: str) -> Stamps:  # noqa: ANN401 - an extra's
    """Return the time and the identifier of each image of `topic`."""
    stamps: Stamps = []
    times: Counter[tuple[int, int]] = Counter()
    for time, image in _messages(reader, topic):
        stamp = image.header.stamp
        which = (time, _nanoseconds(image))
        stamps.append((stamp.sec + stamp.nanosec * 1e-9, Recorded(*which, times[which])))
        times[which] += 1
    return stamps


def read_image_at(path: Path, reader: Any, topic: str, which: Recorded) -> NDArray[Any]:  # noqa: ANN401
    """Return one image: (H, W) depth as stored, or (H, W, 3) RGB."""
    images = (image for _t, image in _messages(reader, topic, which.time))
    alike = (image for image in images if _nanoseconds(image) == which.stamp)
    image = next(islice(alike, which.number, None), None)
    if image is None:
        raise FormatError(path, f"lacks an image of {topic}", "copy the whole bag again")
    return decode(path, image)


def read_camera(path: Path, reader: Any, topics: Topics) -> CameraFile | None:  # noqa: ANN401
    """Return the camera of the CameraInfo, with equal messages throughout; None without a topic.

    For rectified images the camera is the projection matrix, without lens distortion.
    """
    if topics.camera is None:
        return None
    stated = _calibration(reader, topics.camera)
    if stated is None:
        found = f"{topics.camera} holds no CameraInfo"
        raise FormatError(path, found, "give --intrinsics fx,fy,cx,cy")
    lens = {"D": list(stated.distortion), "distortion_model": stated.model}
    matrix, distortion = stated.matrix, distortion_in(path, lens)
    if topics.is_rectified:
        matrix = stated.projection if stated.projection.any() else matrix
        distortion = NO_DISTORTION
    width, height = stated.size
    return CameraFile.from_matrix(path, matrix, width=width, height=height, distortion=distortion)


def _calibration(reader: Any, topic: str) -> Calibration | None:  # noqa: ANN401 - an extra's
    """Return the first CameraInfo of `topic`, None if there is none."""
    _t, info = next(_messages(reader, topic), (0, None))
    K, P, D = (getattr(info, name, getattr(info, name.upper(), None)) for name in "kpd")
    if info is None or K is None:
        return None
    return Calibration(
        size=(int(info.width), int(info.height)),
        matrix=np.asarray(K, np.float64).reshape(3, 3),
        projection=np.asarray(P, np.float64).reshape(3, 4)[:, :3],
        distortion=tuple(np.asarray(() if D is None else D).tolist()),
        model=info.distortion_model,
    )


def _messages(reader: Any, topic: str, recorded: int | None = None) -> Iterator[tuple[int, Any]]:  # noqa: ANN401
    """Yield the messages of `topic` with their time, only at the nanosecond `recorded` if given."""
    connections = [each for each in reader.connections if each.topic == topic]
    stop = None if recorded is None else recorded + 1
    for connection, time, raw in reader.messages(connections, start=recorded, stop=stop):
        if not isinstance(time, int):  # SQLite keeps any type in any column
            raise TypeError(f"a message's time is the {type(time).__name__} {str(time)[:40]!r}")
        yield time, reader.deserialize(raw, connection.msgtype)


def _nanoseconds(image: Any) -> int:  # noqa: ANN401 - an extra's
    """Return the time in the header of a message."""
    return int(image.header.stamp.sec) * 10**9 + int(image.header.stamp.nanosec)
