"""Registered RGB-D frames in ROS 1 and ROS 2 bags, with the `rosbags` package (the extra `ros`).

Depth is an image of 16UC1 or mono16 (millimetres, 0 = missing) or 32FC1 (metres, NaN = missing),
as in REP 118; colour is rgb8, bgr8, rgba8 or bgra8; `ros_images` decodes both, also if compressed
by image_transport. The camera is the CameraInfo next to the depth topic, or, for depth that is
aligned to colour, next to the colour topic. A bag may hold several cameras: the topics of one
camera begin alike.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipelines.contents import mapping_in
from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.camera_files import CameraFile
from pipelines.frames.encodings.ros_images import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    decode,
    raw_topic,
    shown_by,
)
from pipelines.frames.encodings.yaml_files import read_yaml
from pipelines.frames.lens import NO_DISTORTION, distortion_in
from pipelines.storage.files import existing

IMAGE, CAMERA = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
# In the names of aligned depth topics of drivers; Azure Kinect's is depth_to_rgb.
ALIGNED = ("aligned", "registered", "depth_to_rgb", "depth_to_color")
METADATA = "metadata.yaml"  # of a ROS 2 folder
SQLITE_SIDES = ("-journal", "-wal", "-shm")  # files that SQLite opens next to a database
EXTRA = "install it with `pip install symgrasp[ros]`"


class Recorded(NamedTuple):
    """Identifier of an image in a topic; several may have one time, as from `rosbag` filters."""

    time: int  # nanoseconds, of the recording
    stamp: int  # nanoseconds, of the image's header
    number: int  # among the images of the topic with this time and stamp, from 0


Stamps = list[tuple[float, Recorded]]  # seconds of the image, and its identifier


@dataclass(frozen=True)
class Topics:
    """The topics of an RGB-D camera; `camera`: topic of the depth's CameraInfo, if any."""

    color: str
    depth: str
    camera: str | None = None

    @property
    def is_aligned(self) -> bool:
        """Whether the name of the depth topic states that depth is aligned to colour."""
        return _is_aligned(self.depth)

    @property
    def is_rectified(self) -> bool:
        """Whether the name of the depth topic states that lens distortion was removed."""
        return "rect" in raw_topic(self.depth).rpartition("/")[2]

    @property
    def shared(self) -> str:
        """Common beginning of both topics, in whole parts, such as `/left` of a camera `left`."""
        return "/".join(self.depth.split("/")[: _shared(self.color, self.depth)])

    @property
    def name(self) -> str:
        """A name for the camera among others of the bag."""
        return (self.shared or self.color).strip("/")


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
    cameras = [_with_info(camera, infos) for camera in _cameras(colors, depths)]
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
    """Return a sentence for each depth topic that may belong to a camera and is not read."""
    others = [camera.depth for camera in cameras if camera not in read]
    sentences = [f"{depth} is passed over: it is not called aligned" for depth in others]
    if set(colors) != {camera.color for camera in read}:
        known = {camera.depth for camera in cameras}
        sentences += [
            f"{depth} is passed over: by the topics' names it belongs to no other camera"
            for depth in depths
            if _is_aligned(depth) and depth not in known
        ]
    return sentences


def _cameras(colors: list[str], depths: list[str]) -> list[Topics]:
    """Return one camera for each common beginning and colour topic, aligned cameras first.

    A camera has several depth topics (aligned to different images, rectified): the first by name
    is taken. Depth without a recorded colour pairs with another camera's colour, already taken.
    """
    pairs = [
        Topics(max(colors, key=lambda color: (_shared(color, depth), color)), depth)
        for depth in depths
    ]
    pairs.sort(key=lambda pair: (not pair.is_aligned, -_shared(pair.color, pair.depth), pair.depth))
    cameras: list[Topics] = []
    for pair in pairs:
        if all(pair.color != c.color and pair.shared != c.shared for c in cameras):
            cameras.append(pair)
    return cameras


def _is_aligned(depth: str) -> bool:
    return any(word in depth for word in ALIGNED)


def _with_info(camera: Topics, infos: set[str]) -> Topics:
    sources = (camera.depth, camera.color) if camera.is_aligned else (camera.depth,)
    found = (each for source in sources for each in _infos(source) if each in infos)
    return replace(camera, camera=next(found, None))


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
    _t, info = next(_messages(reader, topics.camera), (0, None))
    K, P, D = (getattr(info, name, getattr(info, name.upper(), None)) for name in "kpd")
    if info is None or K is None:
        found = f"{topics.camera} holds no CameraInfo"
        raise FormatError(path, found, "give --intrinsics fx,fy,cx,cy")
    matrix = np.asarray(K, np.float64).reshape(3, 3)
    stated = {"D": np.asarray(() if D is None else D).tolist()}
    distortion = distortion_in(path, stated | {"distortion_model": info.distortion_model})
    if topics.is_rectified:
        projection = np.asarray(P, np.float64).reshape(3, 4)[:, :3]
        matrix, distortion = projection if projection.any() else matrix, NO_DISTORTION
    facts = {"width": int(info.width), "height": int(info.height), "distortion": distortion}
    return CameraFile.from_matrix(path, matrix, **facts)


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


def _infos(topic: str) -> list[str]:
    """Return the topics in which drivers publish the CameraInfo of an image topic."""
    parts = raw_topic(topic).split("/")
    return ["/".join([*parts[:end], name]) for end, name in _PLACES if len(parts) > abs(end)]


_PLACES = ((-1, "camera_info"), (-2, "camera_info"), (-2, "info/camera_info"))


def _shared(topic: str, other: str) -> int:
    """Return the number of equal leading parts of two topics, as topics of one camera have."""
    pairs = list(zip(topic.split("/"), other.split("/"), strict=False))
    return next((i for i, (one, two) in enumerate(pairs) if one != two), len(pairs))
