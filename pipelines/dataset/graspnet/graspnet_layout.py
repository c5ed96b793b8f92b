"""Layout of GraspNet-1Billion's scenes: splits, cameras, scenes, frames."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.dataset import convex_pieces
from pipelines.errors import FormatError, SymgraspError, counted
from pipelines.frames.graspnet_scene import read_object_ids, read_pose_array
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.storage.array_files import read_npy
from pipelines.storage.images import read_image

SURROUNDINGS_FILE = "surroundings.npz"
SPLITS = {
    "train": range(100),
    "seen": range(100, 130),
    "similar": range(130, 160),
    "novel": range(160, 190),
}
# A synthesized split with more scenes than GraspNet's continues 1000, 2000, ... above its numbers.
BLOCK, SPLIT_BLOCKS = 1000, 10
IMAGE_KINDS = ("rgb", "depth", "label")


@dataclass(frozen=True)
class FrameFiles:
    """Paths of one frame of one camera."""

    camera_folder: Path
    scene_id: int
    camera: str
    frame_id: int

    @property
    def name(self) -> str:
        """Name of the frame relative to the root, as in the grasps.h5 of `infer ROOT`."""
        return f"scenes/scene_{self.scene_id:04d}/{self.camera}/{self.frame_id:04d}"

    def path(self, kind: str) -> Path:
        """Return the file of `kind`: rgb, depth, label, annotations, meta or rect."""
        suffix = {"annotations": "xml", "meta": "mat", "rect": "npy"}.get(kind, "png")
        return self.camera_folder / kind / f"{self.frame_id:04d}.{suffix}"


@dataclass(frozen=True)
class SceneFiles:
    """One scene seen by one camera."""

    folder: Path  # ROOT/scenes/scene_NNNN
    scene_id: int
    camera: str

    @property
    def name(self) -> str:
        """scene_NNNN_CAMERA."""
        return scene_name(self.scene_id, self.camera)

    @property
    def camera_folder(self) -> Path:
        """ROOT/scenes/scene_NNNN/CAMERA."""
        return self.folder / self.camera

    @property
    def object_ids(self) -> list[int]:
        """Object ids of the scene, in the order of its poses and collision labels."""
        return read_object_ids(self.folder / "object_id_list.txt")

    @property
    def surroundings_path(self) -> Path:
        """ROOT/scenes/scene_NNNN/surroundings.npz, of `synthesize`; few scenes have one."""
        return self.folder / SURROUNDINGS_FILE

    @property
    def surroundings(self) -> list[Mesh]:
        """Convex obstacles except objects and the table, table frame, metres."""
        return convex_pieces.read(path) if (path := self.surroundings_path).is_file() else []

    @property
    def frame_ids(self) -> list[int]:
        """Ids of the frames with a depth image, ascending."""
        return self.ids_of("depth")

    def ids_of(self, kind: str) -> list[int]:
        """Return the ids of the frames with a file of `kind`, as listed in `FrameFiles.path`."""
        files = (self.camera_folder / kind).glob("*" + self.frame(0).path(kind).suffix)
        return sorted(int(file.stem) for file in files if file.stem.isdecimal())

    @property
    def image_ids(self) -> list[int]:
        """Ids of the frames with an image of any kind, ascending.

        A root may hold the images of few frames and the annotations of all.
        """
        return sorted({frame_id for kind in IMAGE_KINDS for frame_id in self.ids_of(kind)})

    @property
    def camera_poses(self) -> Array:
        """Transforms (n, 4, 4) from camera i to camera 0, metres."""
        return read_pose_array(self.camera_folder / "camera_poses.npy", ndim=3)

    @property
    def cam0_wrt_table(self) -> Array:
        """Transform (4, 4) from camera 0 to the table; the table's top is z = 0, z up, metres."""
        return read_pose_array(self.camera_folder / "cam0_wrt_table.npy", ndim=2)

    def table_from_camera(self, frame_id: int) -> Array:
        """Return the transform (4, 4) from the frame's camera to the table, metres."""
        poses = self.camera_poses
        if frame_id >= len(poses):
            path = self.camera_folder / "camera_poses.npy"
            raise FormatError(
                path, f"holds {counted(len(poses), 'pose')}", f"frame {frame_id} has none"
            )
        return np.asarray(self.cam0_wrt_table @ poses[frame_id])

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of `camK.npy`, with the size of the scene's first depth image."""
        path = self.camera_folder / "camK.npy"
        K = read_npy(path).astype(np.float64)
        if K.shape != (3, 3):
            raise FormatError(path, f"a matrix of shape {K.shape}", "(3, 3) is expected")
        first = next(iter(self.frames()), None)
        if first is None:
            raise SymgraspError(f"{self.camera_folder / 'depth'} holds no frames; NNNN.png")
        height, width = read_image(first.path("depth")).shape[:2]
        return Intrinsics.from_matrix(K, width, height)

    def frame(self, frame_id: int) -> FrameFiles:
        """Return the files of one frame."""
        return FrameFiles(self.camera_folder, self.scene_id, self.camera, frame_id)

    def frames(self) -> list[FrameFiles]:
        """Return the files of every frame with a depth image."""
        return [self.frame(frame_id) for frame_id in self.frame_ids]


def scene_name(scene_id: int, camera: str) -> str:
    """Return scene_NNNN_CAMERA, the name of results of a scene seen by one camera."""
    return f"scene_{scene_id:04d}_{camera}"


def frame_key(name: str) -> tuple[int, str, int] | None:
    """Return (scene id, camera, frame id) of a name ending in `scene_NNNN/CAMERA/NNNN`."""
    match = re.search(r"scene_(\d{4})/(\w+)/(\d{4})$", name)
    return None if match is None else (int(match[1]), match[2], int(match[3]))


def split_or_none(scene_id: int) -> str:
    """Return the name in SPLITS of the split of a scene; empty for a scene of no split."""
    number = scene_id % BLOCK
    return next((name for name, scenes in SPLITS.items() if number in scenes), "")


def split_of_scene(scene_id: int) -> str:
    """Return the name in SPLITS of the split of a scene.

    Raises:
        SymgraspError: the scene is in no split.
    """
    if split := split_or_none(scene_id):
        return split
    raise SymgraspError(
        f"scene {scene_id} is in no split; scenes are numbered 0 to 189, or {BLOCK}, "
        f"{2 * BLOCK}, ... above"
    )


def scenes_of_split(split: str) -> list[int]:
    """Return the numbers that scenes of a split, one of SPLITS, may have, ascending."""
    return [block * BLOCK + number for block in range(SPLIT_BLOCKS) for number in SPLITS[split]]
