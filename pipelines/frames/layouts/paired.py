"""Layouts of a colour and a depth image a frame, told apart by the camera file beside them."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipelines.errors import FormatError
from pipelines.frames.camera_search import own_camera_file, shared_camera_file
from pipelines.frames.layouts.layout import Layout, frame_name
from pipelines.frames.rgbd import Frame, FrameSource
from pipelines.frames.rgbd_folder import (
    FrameOptions,
    ImagePair,
    flat_pairs,
    read_with_camera,
    sister_pairs,
)

LONGEST_LOOK = 100_000  # bytes of a camera file that are searched for its key


@dataclass(frozen=True)
class Pairing:
    """How a paired layout is recognised, and where its cameras are.

    Attributes:
        markers: patterns of files below the folder; one that exists makes it this layout.
        pairs: lists the folder's pairs of images.
        cameras: names of the frame's camera file, the first that exists; `{stem}` is the pair's.
        key: text that the marker must hold, as files of one name have several forms.
    """

    name: str
    markers: tuple[str, ...]
    pairs: Callable[[Path], list[ImagePair]]
    cameras: tuple[str, ...] = ()
    key: str = ""

    def is_in(self, folder: Path) -> bool:
        """Return whether `folder` holds one of the markers."""
        found = (path for marker in self.markers for path in folder.glob(marker))
        return any(not self.key or _holds(path, self.key) for path in found)

    def camera_file(self, folder: Path, pair: ImagePair, shared: Path | None) -> Path | None:
        """Return the camera file of a pair: the layout's, else its own, else the folder's."""
        usual = (folder / name.format(stem=pair.stem) for name in self.cameras)
        found = next((path for path in usual if path.is_file()), None)
        # image_color.png is a frame without a name, whose camera is image_camera.json.
        first = pair.color and pair.color.stem.partition("_")[0]
        for stem in (pair.stem or first, pair.color and pair.color.stem):
            found = found or (own_camera_file(folder, stem) if stem else None)
        return found or shared


def paired_layout(pairing: Pairing) -> Layout:
    """Return the layout of a pairing."""
    return Layout(pairing.name, functools.partial(_find, pairing))


def _holds(path: Path, key: str) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return key.encode() in stream.read(LONGEST_LOOK)


def _find(pairing: Pairing, folder: Path, prefix: str, options: FrameOptions) -> list[FrameSource]:
    if not pairing.is_in(folder):
        return []
    sources, shared = [], shared_camera_file(folder)
    for pair in sorted(pairing.pairs(folder), key=lambda pair: pair.stem):
        name = frame_name(folder, prefix, pair.stem)
        camera = pairing.camera_file(folder, pair, shared)
        files = tuple(path for path in (pair.color, pair.depth, camera) if path is not None)
        read = functools.partial(read_frame, name, pair, camera, options)
        sources.append(FrameSource(name, read, files, pairing.name))
    return sources


def read_frame(name: str, pair: ImagePair, camera: Path | None, options: FrameOptions) -> Frame:
    """Read a pair; raises a FormatError if one of the two is missing, or could be several files."""
    if pair.rivals:
        raise FormatError(
            str(pair.rivals[0]),
            f"and {', '.join(path.name for path in pair.rivals[1:])} are one frame by their names",
            "give each frame a name of its own, as x_color.png and x_depth.png",
        )
    if pair.depth is None or pair.color is None:
        present = pair.color or pair.depth
        missing = "depth" if pair.depth is None else "colour"
        raise FormatError(
            str(present),
            f"has no {missing} image beside it",
            "both have one name, as x_color.png and x_depth.png, or rgb/x.png and depth/x.png",
        )
    return read_with_camera(name, pair.color, pair.depth, camera, options)


PRINCETON_CAMERAS = ("camera-intrinsics.txt", "test-camera-intrinsics.txt")

GRASPNET_SCENE = paired_layout(
    Pairing("GraspNet scene", ("camK.npy", "meta/*.mat"), sister_pairs,
            ("meta/{stem}.mat", "camK.npy")),
)  # fmt: skip
GRASPNET_DEMO = paired_layout(
    Pairing("GraspNet demo folder", ("meta.mat",), flat_pairs, ("meta.mat",))
)
BOP_IMAGE = paired_layout(
    Pairing("BOP single image", ("camera.json", "camera_data.json"), flat_pairs,
            ("camera.json", "camera_data.json"), key="K\""),
)  # fmt: skip
RECORDER = paired_layout(
    Pairing("Open3D / RealSense recorder", ("camera_intrinsic.json", "intrinsic.json"),
            sister_pairs, ("camera_intrinsic.json", "intrinsic.json"), key="intrinsic_matrix"),
)  # fmt: skip
FOUNDATION_POSE = paired_layout(
    Pairing("FoundationPose", ("cam_K.txt",), sister_pairs, ("cam_K.txt",))
)
YCB_VIDEO = paired_layout(Pairing("YCB-Video", ("*-meta.mat",), flat_pairs, ("{stem}-meta.mat",)))
PRINCETON = paired_layout(
    Pairing("7-Scenes / Princeton", ("frame-*.depth.png",), flat_pairs,
            (*PRINCETON_CAMERAS, *(f"../{name}" for name in PRINCETON_CAMERAS))),
)  # fmt: skip
GQCNN = paired_layout(Pairing("gqcnn", ("*.intr",), flat_pairs))
FLAT = paired_layout(Pairing("flat pairs", ("*",), flat_pairs))
SISTERS = paired_layout(Pairing("colour and depth folders", ("depth",), sister_pairs))
