"""Registered RGB-D frames in ROS 1 and ROS 2 bags, with the `rosbags` package (the extra `ros`).

Depth is an image of 16UC1 or mono16 (millimetres, 0 = missing) or 32FC1 (metres, NaN = missing),
as REP 118 has it; colour one of rgb8, bgr8, rgba8, bgra8. The camera is the CameraInfo beside the
depth topic, or, for depth that is aligned to colour, the one beside the colour topic.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, SymgraspError
from pipelines.formats.camera_files import CameraFile

IMAGE, CAMERA = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
COLORS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}
ALIGNED = ("aligned", "registered")  # in the depth topic's name, as drivers have it
EXTRA = "install it with `pip install symgrasp[ros]`"
Stamps = list[tuple[float, int]]  # seconds of the image, and nanoseconds at which it was recorded


@dataclass(frozen=True)
class Topics:
    """The topics of a bag's RGB-D camera."""

    color: str
    depth: str
    camera: str | None

    @property
    def is_aligned(self) -> bool:
        """Whether the depth topic says that it lies on the colour."""
        return any(word in self.depth for word in ALIGNED)


@contextmanager
def open_bag(path: Path) -> Iterator[Any]:
    """Yield rosbags' reader of a `.bag` file or a ROS 2 folder.

    Raises:
        FormatError: the bag is damaged, here or while it is read.
        SymgraspError: `rosbags` is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise SymgraspError(f"{path} is a ROS bag, which needs rosbags; {EXTRA}") from error
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


def find_topics(path: Path, reader: Any) -> Topics:  # noqa: ANN401 - an extra's
    """Return the topics of the RGB-D camera, aligned depth before any other.

    Raises:
        FormatError: no topic of colour or of depth, as their encodings say.
    """
    colors, depths = [], []
    for topic in sorted({c.topic for c in reader.connections if c.msgtype == IMAGE}):
        encoding = next((image.encoding for _t, image in _messages(reader, topic)), "")
        colors += [topic] if encoding in COLORS else []
        depths += [topic] if encoding in DEPTHS else []
    if not colors or not depths:
        topics = ", ".join(sorted({c.topic for c in reader.connections})) or "none"
        raise FormatError(
            path,
            f"has no {'depth' if colors else 'colour'} images; its topics are {topics}",
            f"raw images are read: {', '.join(COLORS)} beside {', '.join(DEPTHS)}",
        )
    depth = min(depths, key=lambda topic: (not any(word in topic for word in ALIGNED), topic))
    color = max(colors, key=lambda topic: (_shared(topic, depth), topic))
    cameras = {c.topic for c in reader.connections if c.msgtype == CAMERA}
    found = Topics(color, depth, None)
    sources = (depth, color) if found.is_aligned else (depth,)
    camera = next((each for source in sources for each in _infos(source) if each in cameras), None)
    return Topics(color, depth, camera)


def read_stamps(reader: Any, topic: str) -> Stamps:  # noqa: ANN401 - an extra's
    """Return when each image of `topic` was taken, and when it was recorded."""
    return [
        (image.header.stamp.sec + image.header.stamp.nanosec * 1e-9, recorded)
        for recorded, image in _messages(reader, topic)
    ]


def read_image_at(path: Path, reader: Any, topic: str, recorded: int) -> NDArray[Any]:  # noqa: ANN401
    """Return one image: (H, W) depth as stored, or (H, W, 3) RGB."""
    _t, image = next(_messages(reader, topic, recorded), (0, None))
    if image is None:
        raise FormatError(path, f"lacks an image of {topic}", "copy the whole bag again")
    return decode(path, image)


def read_camera(path: Path, reader: Any, topic: str) -> CameraFile:  # noqa: ANN401 - an extra's
    """Return the camera of a CameraInfo topic, which is the same in all its messages."""
    _t, info = next(_messages(reader, topic), (0, None))
    K = None if info is None else getattr(info, "k", getattr(info, "K", None))
    if info is None or K is None:
        raise FormatError(path, f"{topic} holds no CameraInfo", "give --intrinsics fx,fy,cx,cy")
    matrix = np.asarray(K, np.float64).reshape(3, 3)
    facts = {"width": int(info.width), "height": int(info.height)}
    return CameraFile.from_matrix(path, matrix, **facts)


def decode(path: Path, image: Any) -> NDArray[Any]:  # noqa: ANN401 - an extra's
    """Return the pixels of an Image message; rows may be padded, numbers of either byte order.

    Raises:
        FormatError: an unknown encoding, or fewer bytes than rows.
    """
    height, width, step = int(image.height), int(image.width), int(image.step)
    encoding = str(image.encoding)
    if encoding not in DEPTHS and encoding not in COLORS:
        raise FormatError(path, f"has images of {encoding}", f"{', '.join((*DEPTHS, *COLORS))}")
    kind = np.dtype((">" if image.is_bigendian else "<") + DEPTHS.get(encoding, "u1"))
    row = width * CHANNELS.get(encoding, 1) * kind.itemsize
    data = np.asarray(image.data, np.uint8).ravel()
    if min(height, width) < 1 or step < row or data.size < height * step:
        found = f"has an image of {width}x{height}, {step} bytes a row, in {data.size} bytes"
        raise FormatError(path, found, "copy the whole bag again")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    pixels = rows.view(kind)
    if encoding in DEPTHS:
        return pixels
    channels = pixels.reshape(height, width, CHANNELS[encoding])
    return np.ascontiguousarray(channels[:, :, COLORS[encoding]])


def _messages(reader: Any, topic: str, recorded: int | None = None) -> Iterator[tuple[int, Any]]:  # noqa: ANN401
    """Yield the messages of `topic` with their time; only those of one nanosecond, if given."""
    connections = [each for each in reader.connections if each.topic == topic]
    stop = None if recorded is None else recorded + 1
    for connection, time, raw in reader.messages(connections, start=recorded, stop=stop):
        yield time, reader.deserialize(raw, connection.msgtype)


def _infos(topic: str) -> list[str]:
    """Return where a driver puts the CameraInfo of an image topic."""
    parts = topic.split("/")
    return ["/".join([*parts[:end], name]) for end, name in _PLACES if len(parts) > abs(end)]


_PLACES = ((-1, "camera_info"), (-2, "camera_info"), (-2, "info/camera_info"))


def _shared(topic: str, other: str) -> int:
    """Return how many parts two topics begin with alike: those of one camera do."""
    pairs = list(zip(topic.split("/"), other.split("/"), strict=False))
    return next((i for i, (one, two) in enumerate(pairs) if one != two), len(pairs))
