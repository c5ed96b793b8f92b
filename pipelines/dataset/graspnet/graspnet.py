"""A dataset root in GraspNet-1Billion's layout: paths of its files, frames and annotations.

    ROOT/models/NNN/{nontextured.ply,textured.obj,textured.sdf}
    ROOT/grasp_label/NNN_labels.npz
    ROOT/collision_label/scene_NNNN/collision_labels.npz
    ROOT/scenes/scene_NNNN/{object_id_list.txt,rs_wrt_kn.npy}
    ROOT/scenes/scene_NNNN/{kinect,realsense}/{rgb,depth,label,annotations,meta,rect}/NNNN.*
    ROOT/scenes/scene_NNNN/{kinect,realsense}/{camK,camera_poses,cam0_wrt_table}.npy

and, written by our own stages, ROOT/{symmetry,regions}/NNN.json and ROOT/affordance/NNN.h5.
A root may have only some of the cameras, splits and frames; only existing ones are listed.
"""

import logging
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Floats, Singles
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet_layout import (
    BLOCK,
    SPLITS,
    FrameFiles,
    SceneFiles,
    frame_key,
)
from pipelines.errors import FormatError, SymgraspError, UnknownNameError
from pipelines.frames.cameras.camera_files import CameraFile, read_camera_file
from pipelines.frames.depth.depth_checks import MISSING_DEPTH
from pipelines.frames.graspnet_scene import CAMERAS, ObjectPose, read_object_ids, read_poses
from pipelines.frames.rgbd import DepthUnits, Frame, read_depth, read_pair
from pipelines.geometry.camera import Intrinsics
from pipelines.storage.images import read_image, write_image
from pipelines.storage.unfinished import refuse_unfinished

log = logging.getLogger(__name__)

ORIGIN_OF_ROOTS = "roots are those of GraspNet-1Billion, or made by `symgrasp synthesize`"
DEPTH_SCALE = 1000.0  # depth units per metre
DEPTH_UNITS = DepthUnits(DEPTH_SCALE, DEPTH_SCALE, is_certain=True)


@dataclass(frozen=True)
class GraspNetRoot:
    """A dataset root; the module's docstring lists its files."""

    root: Path

    @classmethod
    def finished(cls, root: Path) -> "GraspNetRoot":
        """Return the finished dataset root for reading.

        Raises:
            SymgraspError: a command that makes the root was stopped, or still runs.
        """
        refuse_unfinished(root)
        return cls(root)

    def object_ids(self) -> list[int]:
        """List the ids of `models/`, ascending."""
        return _numbers(self.root / "models", r"(\d{3,})")

    def checked_object_ids(self) -> list[int]:
        """List the ids of `models/`; warn of objects that only objects.json or scenes name."""
        found, named = self.object_ids(), set[int]()
        with suppress(SymgraspError):  # its readers report a damaged file
            named |= {each.object_id for each in object_list.read(self.root / "objects.json")}
        for path in (self.root / "scenes").glob("scene_*/object_id_list.txt"):
            with suppress(SymgraspError):  # the same
                named |= {*read_object_ids(path)}
        if lost := ", ".join(f"{each:03d}" for each in sorted(named - {*found})):
            log.warning(
                "%s lacks objects that objects.json or scenes name: %s; they are left out",
                self.root / "models",
                lost,
            )
        return found

    def scene_ids(self, split: str | None = None) -> list[int]:
        """List the ids of `scenes/`, ascending; only those of `split`, one of SPLITS, if given."""
        scenes = _numbers(self.root / "scenes", r"scene_(\d{4})")
        if split is None:
            return scenes
        if split not in SPLITS:
            raise UnknownNameError("split", split, (*SPLITS, "all"))
        return [scene for scene in scenes if scene % BLOCK in SPLITS[split]]

    def cameras(self, scene_id: int) -> list[str]:
        """List the cameras of a scene."""
        return [name for name in CAMERAS if (self.scene_folder(scene_id) / name).is_dir()]

    def scene(self, scene_id: int, camera: str | None = None) -> SceneFiles:
        """Return the scene as seen by `camera`; by its first camera if None."""
        present = self.cameras(scene_id)
        if not present:
            raise SymgraspError(f"{self._without_cameras(scene_id)}; {ORIGIN_OF_ROOTS}")
        camera = camera or present[0]
        if camera not in present:
            raise UnknownNameError(f"camera of scene {scene_id}", camera, present)
        return SceneFiles(self.scene_folder(scene_id), scene_id, camera)

    def scenes(self, camera: str | None = None, split: str | None = None) -> list[SceneFiles]:
        """Return the scenes as seen by `camera`; by each of their cameras if None."""
        return [
            self.scene(scene_id, name)
            for scene_id in self.scene_ids(split)
            for name in self.cameras(scene_id)
            if camera in (None, name)
        ]

    def chosen_scenes(self, camera: str | None, split: str | None) -> list[SceneFiles]:
        """Return the scenes as `scenes` does; warn of those that have lost their cameras.

        Raises:
            SymgraspError: there are no scenes.
        """
        scenes = self.scenes(camera, split)
        self.warn_of_lost_cameras(split)
        if not scenes:
            wanted = f"{split} scene" if split else "scene"
            wanted += f" seen by {camera}" if camera else ""
            chosen = "name another --split or --camera"
            advice = chosen if split or camera else "`symgrasp synthesize` writes some"
            raise SymgraspError(f"{self.root} holds no {wanted}; {advice}")
        return scenes

    def warn_of_lost_cameras(self, split: str | None = None) -> None:
        """Warn, once in a process, of each scene of `split` without a camera's folder."""
        for scene_id in self.scene_ids(split):
            if not self.cameras(scene_id):
                _warn_once(f"{self._without_cameras(scene_id)}, so it is left out")

    def frame(self, name: str) -> FrameFiles:
        """Return the frame of a name that ends in `scene_NNNN/CAMERA/NNNN`."""
        key = frame_key(name)
        if key is None:
            raise SymgraspError(f"{name} is no frame of a dataset; scene_NNNN/CAMERA/NNNN is")
        return self.scene(key[0], key[1]).frame(key[2])

    def scene_folder(self, scene_id: int) -> Path:
        """ROOT/scenes/scene_NNNN."""
        return self.root / "scenes" / f"scene_{scene_id:04d}"

    def model_path(self, object_id: int) -> Path:
        """ROOT/models/NNN/nontextured.ply."""
        return self.root / "models" / f"{object_id:03d}" / "nontextured.ply"

    def textured_path(self, object_id: int, suffix: str) -> Path:
        """ROOT/models/NNN/textured.obj or .sdf: the same surface; not every root has them."""
        return self.root / "models" / f"{object_id:03d}" / f"textured{suffix}"

    def grasp_label_path(self, object_id: int) -> Path:
        """ROOT/grasp_label/NNN_labels.npz."""
        return self.root / "grasp_label" / f"{object_id:03d}_labels.npz"

    def collision_label_path(self, scene_id: int) -> Path:
        """ROOT/collision_label/scene_NNNN/collision_labels.npz."""
        folder = self.root / "collision_label" / f"scene_{scene_id:04d}"
        return folder / "collision_labels.npz"

    def symmetry_path(self, object_id: int) -> Path:
        """ROOT/symmetry/NNN.json, written by `annotate-symmetry`."""
        return self.root / "symmetry" / f"{object_id:03d}.json"

    def region_path(self, object_id: int) -> Path:
        """ROOT/regions/NNN.json, written by hand: overrides the regions of `symmetry/`."""
        return self.root / "regions" / f"{object_id:03d}.json"

    def affordance_path(self, object_id: int) -> Path:
        """ROOT/affordance/NNN.h5, written by `refine-grasps`."""
        return self.root / "affordance" / f"{object_id:03d}.h5"

    def read_annotation(self, frame: FrameFiles) -> list[ObjectPose]:
        """Read the poses of a frame's objects, camera frame, in the order of the object list.

        The XML has four decimals; if `meta/NNNN.mat` holds the same poses, its digits are used.
        """
        return read_poses(frame.path("annotations"), frame.path("meta"))

    def read_label(self, frame: FrameFiles) -> NDArray[np.uint8 | np.uint16]:
        """Read the label image (H, W) of 8 or 16 bits: object id + 1, 0 = background."""
        path = frame.path("label")
        label = read_image(path)
        if label.ndim != 2 or label.dtype not in (np.uint8, np.uint16):
            found = f"{label.dtype} of shape {label.shape}"
            raise FormatError(path, found, "8 or 16 bit in one channel is expected")
        return label

    def read_depth(self, frame: FrameFiles) -> tuple[Singles, Intrinsics]:
        """Read a frame's depth (H, W), metres, 0 = missing, with the camera of `camK.npy`."""
        depth = read_depth(frame.path("depth"), DEPTH_UNITS)
        camera = self._camera_file(frame)
        return depth, camera.at(depth.shape[1], depth.shape[0])

    def read_frame(self, frame: FrameFiles) -> Frame:
        """Read a frame's images, with the camera of `camK.npy`."""
        color, depth = frame.path("rgb"), frame.path("depth")
        found = read_pair(color, depth, self._camera_file(frame), DEPTH_UNITS)
        return replace(found, name=frame.name)

    def _without_cameras(self, scene_id: int) -> str:
        return f"{self.scene_folder(scene_id)} has no folder {' or '.join(CAMERAS)}"

    def _camera_file(self, frame: FrameFiles) -> CameraFile:
        return read_camera_file(frame.camera_folder / "camK.npy", frame.path("depth").stem)


def write_depth(path: Path, depth: Floats) -> None:
    """Write `depth/NNNN.png` from metres (H, W), 0 or nan = missing: uint16 millimetres."""
    millimetres = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0) * DEPTH_SCALE)
    measured = (millimetres > 0) & (millimetres < MISSING_DEPTH)
    write_image(path, np.where(measured, millimetres, 0).astype(np.uint16))


def write_label(path: Path, label: NDArray[np.integer]) -> None:
    """Write `label/NNNN.png` (H, W): object id + 1, 0 = background; 8 bits if they suffice."""
    write_image(path, label.astype(np.uint8 if label.max(initial=0) < 256 else np.uint16))


@lru_cache
def _warn_once(sentence: str) -> None:
    log.warning(sentence)


def _numbers(folder: Path, pattern: str) -> list[int]:
    if not folder.is_dir():
        raise SymgraspError(f"{folder} does not exist; {ORIGIN_OF_ROOTS}")
    matches = (re.fullmatch(pattern, child.name) for child in folder.iterdir())
    return sorted(int(match[1]) for match in matches if match is not None)
