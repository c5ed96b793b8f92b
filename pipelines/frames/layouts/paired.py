"""Layouts of a colour and a depth image per frame, distinguished by their camera files."""

import functools
import re
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_files import read_camera_file, read_units
from pipelines.frames.cameras.camera_search import own_camera_file, shared_camera_file
from pipelines.frames.depth.scale_files import read_scale, scale_file
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame
from pipelines.frames.pairing.image_names import view_of
from pipelines.frames.pairing.image_pairs import ImagePair, flat_pairs, sister_pairs
from pipelines.frames.pairing.unread_files import unread_partner
from pipelines.frames.rgbd import DepthUnits, Frame, read_pair
from pipelines.storage.files import existing

SAME_CAMERA = 0.5  # pixels by which rounded intrinsics of one camera may differ
MOST_LABELS, LABEL_STRIDE = 64, 3  # colours of a picture of labels, counted in each third pixel
ONE_NAME = "both have one name, as x_color.png and x_depth.png, or rgb/x.png and depth/x.png"
STAMPED = re.compile(r"\d{10}")  # a time in a file's name: seconds since 1970, or microseconds
BY_TIME = "or by time in rgb.txt and depth.txt as of TUM, whose depth has 5000 units per metre"
LONGEST_LOOK = 100_000  # bytes of a camera file that are searched for its key


@dataclass(frozen=True)
class Pairing:
    """A layout of pairs of images: files that identify it, and names of its camera files."""

    name: str  # as in `Layout`
    # Patterns of files below a folder; one existing file identifies this layout.
    markers: tuple[str, ...]
    pairs: Callable[[Path], list[ImagePair]]  # lists the folder's pairs of images
    # Names of a frame's camera file, of which the first existing counts; `{stem}` is the pair's.
    cameras: tuple[str, ...] = ()
    key: str = ""  # text that the marker must hold, as files of one name have several forms

    def is_in(self, folder: Path) -> bool:
        """Return whether `folder` holds one of the markers."""
        found = (path for marker in self.markers for path in folder.glob(marker))
        return any(not self.key or holds_text(path, self.key) for path in found)

    def camera_file(
        self, folder: Path, pair: ImagePair, shared: Path | None, listed: Container[str]
    ) -> Path | None:
        """Return the camera file of a pair: the layout's, else the pair's, else the folder's.

        `listed`: all names in `folder`.
        """
        usual = (folder / name.format(stem=pair.stem) for name in self.cameras)
        found = next((path for path in usual if path.is_file()), None)
        # image_color.png is a frame without a name, whose camera is image_camera.json.
        first = pair.color and pair.color.stem.partition("_")[0]
        images = [each and each.stem for each in (pair.color, pair.depth)]
        stems = [pair.stem or first, *images]
        for stem in stems if pair.view != "depth" else reversed(stems):
            found = found or (own_camera_file(folder, stem, listed) if stem else None)
        return found or shared

    def find(self, folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
        """Yield the frames of `folder`, none if the folder has another layout."""
        if not self.is_in(folder):
            return
        pairs = sorted(self.pairs(folder), key=lambda pair: pair.stem)
        if not pairs:
            return
        shared = {view: shared_camera_file(folder, view) for view in {each.view for each in pairs}}
        listed, scale = {path.name for path in folder.iterdir()}, scale_file(folder)
        for pair in pairs:
            camera = self.camera_file(folder, pair, shared[pair.view], listed)
            read = functools.partial(read_paired, pair, camera, options, scale)
            files = (pair.color, pair.depth, camera, scale)
            yield FoundFrame(pair.stem, read, files, is_whole=pair.is_whole)


def holds_text(path: Path, key: str) -> bool:
    """Return whether the beginning of the file `path` contains `key`; False if it is unreadable."""
    try:
        with existing(path).open("rb") as stream:
            return key.encode() in stream.read(LONGEST_LOOK)
    except (SymgraspError, OSError):
        return False


def read_paired(
    pair: ImagePair, camera: Path | None, options: FrameOptions, scale: Path | None = None
) -> Frame:
    """Read a pair; raises a FormatError if an image is missing, or could be several files.

    `scale`: the file that states the unit of the depth, if `camera` does not.
    """
    if pair.rivals:
        raise FormatError(
            str(pair.rivals[0]),
            f"and {', '.join(path.name for path in pair.rivals[1:])} are one frame by their names",
            "give each frame a name of its own, as x_color.png and x_depth.png",
        )
    if pair.depth is None or pair.color is None:
        _refuse_lone(pair)
    if camera is not None and options.camera is None:
        _refuse_two_cameras(camera, pair.depth)
    frame = read_with_camera(pair.color, pair.depth, camera, options, scale=scale)
    if pair.color == pair.depth.with_name(f"{pair.stem}{pair.color.suffix}"):
        _refuse_labels(pair.color, frame.color)
    return frame


def read_with_camera(
    color: Path,
    depth: Path,
    camera_file: Path | None,
    options: FrameOptions,
    usual_units: float = DepthUnits().integers,
    scale: Path | None = None,
) -> Frame:
    """Read one frame by the stated options first, then `camera_file`, `scale`, `usual_units`.

    `scale`: a file that states the unit of the depth alone.

    Raises:
        FormatError: no intrinsics, or a fault of the images (see `read_depth`).
    """
    camera, units = options.camera, None
    if camera_file is not None and camera is None:
        camera = read_camera_file(camera_file, color.stem, view_of(color, depth))
        units = camera.units_per_metre
    elif camera_file is not None and options.needs_units:
        units = read_units(camera_file, color.stem, view_of(color, depth))
    if units is None and scale is not None and options.needs_units:
        units = read_scale(scale)
    return read_pair(color, depth, camera, options.depth_units(units, usual_units))


def _refuse_labels(path: Path, image: NDArray[np.uint8]) -> None:
    """Raise a FormatError if an `image` whose name says nothing has as few colours as labels."""
    sample = image[::LABEL_STRIDE, ::LABEL_STRIDE].astype(np.uint32)
    colors = len(np.unique(sample @ np.array([1 << 16, 1 << 8, 1], np.uint32)))
    if colors <= MOST_LABELS:
        found = f"has {colors} colours, as a picture of labels has"
        raise FormatError(path, found, "name the colour image as x_color.png")


def _refuse_lone(pair: ImagePair) -> NoReturn:
    """Raise a FormatError on the missing image of a pair, naming a file in its place."""
    present, missing = (pair.color, "depth") if pair.depth is None else (pair.depth, "colour")
    found, expected = f"has no {missing} image next to it", ONE_NAME
    if present is not None and STAMPED.search(present.stem):
        expected = f"{ONE_NAME}, {BY_TIME}"
    if present is not None and (unread := unread_partner(present, missing)) is not None:
        found, expected = f"{found} but {unread[0]}", unread[1] or expected
    raise FormatError(str(present), found, expected)


def _refuse_two_cameras(camera: Path, depth: Path) -> None:
    """Raise a FormatError if `depth` has a camera file of its own that states another camera."""
    other = own_camera_file(depth.parent, depth.stem)
    if other is None or other == camera:
        return
    one, two = (read_camera_file(path, depth.stem) for path in (camera, other))
    first, second = ((each.fx, each.fy, each.cx, each.cy) for each in (one, two))
    if not np.allclose(first, second, rtol=0.0, atol=SAME_CAMERA):
        expected = (
            "give that of the depth image, or of the colour it is registered to, as --intrinsics"
        )
        raise FormatError(camera, f"and {other.name} are two cameras of one frame", expected)


BOP_CAMERAS = ("camera.json", "camera_data.json")
RECORDER_CAMERAS = ("camera_intrinsic.json", "intrinsic.json")
PRINCETON_CAMERAS = ("camera-intrinsics.txt", "test-camera-intrinsics.txt")

GRASPNET_SCENE = Pairing(
    "GraspNet scene", ("camK.npy", "meta/*.mat"), sister_pairs, ("meta/{stem}.mat", "camK.npy")
)
GRASPNET_DEMO = Pairing("GraspNet demo folder", ("meta.mat",), flat_pairs, ("meta.mat",))
BOP_IMAGE = Pairing("BOP single image", BOP_CAMERAS, flat_pairs, BOP_CAMERAS, key='K"')
RECORDER = Pairing(
    "Open3D / RealSense recorder",
    RECORDER_CAMERAS,
    sister_pairs,
    RECORDER_CAMERAS,
    key="intrinsic_matrix",
)
FOUNDATION_POSE = Pairing("FoundationPose", ("cam_K.txt",), sister_pairs, ("cam_K.txt",))
YCB_VIDEO = Pairing("YCB-Video", ("*-meta.mat",), flat_pairs, ("{stem}-meta.mat",))
PRINCETON = Pairing(
    "7-Scenes / Princeton",
    ("frame-*.depth.png",),
    flat_pairs,
    (*PRINCETON_CAMERAS, *(f"../{name}" for name in PRINCETON_CAMERAS)),
)
REPLICA_CAMERAS = ("../../cam_params.json", "../cam_params.json")
REPLICA = Pairing("Replica", REPLICA_CAMERAS, flat_pairs, REPLICA_CAMERAS)
GQCNN = Pairing("gqcnn", ("*.intr",), flat_pairs)
FLAT = Pairing("flat pairs", ("*",), flat_pairs)
SISTERS = Pairing("colour and depth folders", ("*",), sister_pairs)
