"""Topics of a ROS bag that form RGB-D cameras, by their names and their CameraInfo.

The topics of one camera begin alike. Of several colour topics, that one is taken which the depth is
aligned to: drivers publish the pictures of both sides of a stereo camera, pictures aligned to the
depth camera, and pictures with and without lens distortion.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from pipelines.array_types import Array
from pipelines.frames.encodings.ros_images import raw_topic

# In the names of aligned depth topics of drivers; Azure Kinect's is depth_to_rgb.
ALIGNED = ("aligned", "registered", "depth_to_rgb", "depth_to_color")
FRONT_WORDS = ("color", "rgb")  # of the pictures that depth is aligned to, in many drivers
MATRIX_TOLERANCE = 1e-3  # relative, between the matrices of one camera in two messages


@dataclass(frozen=True)
class Topics:
    """The topics of an RGB-D camera; `camera`: topic of the depth's CameraInfo, if any.

    `rivals`: other colour topics that fit the depth topic as well.
    """

    color: str
    depth: str
    camera: str | None = None
    rivals: tuple[str, ...] = ()

    @property
    def is_aligned(self) -> bool:
        """Whether the name of the depth topic states that depth is aligned to colour."""
        return is_aligned_depth(self.depth)

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

    @property
    def note(self) -> str:
        """A sentence on the colour topics that fit as well."""
        others = ", ".join(self.rivals)
        return f"colour is read from {self.color}; {others} may belong to {self.depth} as well"


@dataclass(frozen=True)
class Calibration:
    """A CameraInfo, pixels."""

    size: tuple[int, int]  # width, height
    matrix: Array  # (3, 3) of the image as taken
    projection: Array  # (3, 3) of the rectified image, zeros if there is none
    distortion: tuple[float, ...] = ()
    model: str = ""  # of the distortion

    def is_of(self, color: "Calibration") -> bool:
        """Return whether this CameraInfo of depth states the size and matrix of the `color`'s."""
        near = (
            np.allclose(self.matrix, matrix, rtol=MATRIX_TOLERANCE, atol=0.0)
            for matrix in (color.matrix, color.projection)
        )
        return self.size == color.size and any(near)


Calibrations = Mapping[str, Calibration]  # by the topic of the CameraInfo


def cameras_of_topics(
    colors: Sequence[str], depths: Sequence[str], calibrations: Calibrations
) -> list[Topics]:
    """Return one camera for each common beginning and colour topic, aligned cameras first.

    A camera has several depth topics (aligned to different images, rectified): the first by name
    is taken. Depth without a recorded colour pairs with another camera's colour, already taken.
    """
    pairs = [_with_color(depth, colors, calibrations) for depth in depths]
    pairs.sort(key=lambda pair: (not pair.is_aligned, -_shared(pair.color, pair.depth), pair.depth))
    cameras: list[Topics] = []
    for pair in pairs:
        if all(pair.color != c.color and pair.shared != c.shared for c in cameras):
            cameras.append(pair)
    return cameras


def is_aligned_depth(depth: str) -> bool:
    """Return whether the name of a depth topic states that depth is aligned to colour."""
    return any(word in depth for word in ALIGNED)


def with_info(camera: Topics, infos: Iterable[str]) -> Topics:
    """Return `camera` with the topic of its CameraInfo, if it is one of `infos`."""
    sources = (camera.depth, camera.color) if camera.is_aligned else (camera.depth,)
    found = (each for source in sources for each in _infos(source) if each in infos)
    return replace(camera, camera=next(found, None))


def _with_color(depth: str, colors: Sequence[str], calibrations: Calibrations) -> Topics:
    """Pair a depth topic with the colour topic that fits best, the first by name of several."""
    fits = {color: _fit(color, depth, calibrations) for color in sorted(colors)}
    best = max(fits.values())
    color, *rivals = (color for color, fit in fits.items() if fit == best)
    return Topics(color, depth, rivals=tuple(rivals))


def _fit(color: str, depth: str, calibrations: Calibrations) -> tuple[int, ...]:
    """Return how well the topics fit; of two tuples the larger one fits better.

    The names of cameras count first, then stated alignment, then CameraInfo, then usual names.
    """
    of_color, of_depth = (
        next((calibrations[info] for info in _infos(topic) if info in calibrations), None)
        for topic in (color, depth)
    )
    is_compared = of_color is not None and of_depth is not None
    is_same = of_color is not None and of_depth is not None and of_depth.is_of(of_color)
    without_lens = of_depth is not None and not any(of_depth.distortion)
    is_rectified = "rect" in _words(depth) or without_lens
    return (
        _shared(color, depth),
        _alignment(color, depth),
        -int(is_compared and not is_same),
        _side(color, depth),
        int(("rect" in _words(color)) == is_rectified),
        int(is_same),
        _in_step(_words(color)[::-1], _words(depth)[::-1]),
    )


def _alignment(color: str, depth: str) -> int:
    """Return 1 if the names state that the images are aligned to each other, -1 if to others."""
    if "to_depth" in color:  # Azure Kinect's rgb_to_depth
        return -1 if is_aligned_depth(depth) else 1
    target = re.search(r"_to_([^/]+)", depth)
    return int(target is not None and target[1] in color.split("/"))


def _side(color: str, depth: str) -> int:
    """Return 1 for colour that is named so, -1 for the right side of a stereo camera, else 0."""
    parts = raw_topic(color).split("/")[_shared(color, depth) :]
    if "right" in _words("/".join(parts)):
        return -1
    return int(any(word in FRONT_WORDS for word in _words(parts[0]))) if parts else 0


def _words(topic: str) -> list[str]:
    return re.split(r"[/_]", raw_topic(topic).lower())


def _infos(topic: str) -> list[str]:
    """Return the topics in which drivers publish the CameraInfo of an image topic."""
    parts = raw_topic(topic).split("/")
    return ["/".join([*parts[:end], name]) for end, name in _PLACES if len(parts) > abs(end)]


_PLACES = ((-1, "camera_info"), (-2, "camera_info"), (-2, "info/camera_info"))


def _shared(topic: str, other: str) -> int:
    """Return the number of equal leading parts of two topics, as topics of one camera have."""
    return _in_step(topic.split("/"), other.split("/"))


def _in_step(one: Sequence[str], other: Sequence[str]) -> int:
    """Return the number of equal leading items."""
    pairs = zip(one, other, strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
