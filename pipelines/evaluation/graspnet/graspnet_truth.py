"""The objects, poses and table of a scene for GraspNet's protocol, and their digests."""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles
from pipelines.dataset.graspnet.signed_distance import as_stored, read_sdf
from pipelines.dataset.meshes import read_mesh, read_solid_mesh, read_vertices
from pipelines.errors import FormatError
from pipelines.frames.graspnet_scene import ObjectPose, annotated_ids, read_annotation_xml
from pipelines.geometry.meshes.mesh import sample_surface
from pipelines.geometry.numerics.single_precision import single_precision_grid
from pipelines.grasp_files.exports.graspnet_dump import DumpedScene
from pipelines.metrics.graspnet.box_collision import NUM_CLOUD_SAMPLES, voxel_means
from pipelines.metrics.graspnet.graspnet_frames import (
    ExactScene,
    GridObject,
    GridScene,
    SolidObject,
)
from pipelines.metrics.mesh_collision import MeshCollider
from pipelines.storage.provenance import FileVersion, digest_folder, digest_if_there, digest_text

KEPT_OBJECTS = 28  # in memory, with a grid of 8 MB each; no split of GraspNet-1Billion has more


@dataclass(frozen=True)
class SceneTruth:
    """One scene seen by one camera."""

    root: GraspNetRoot
    files: SceneFiles
    exact: bool  # True: the dataset's exact objects and poses; False: as graspnetAPI reads them
    T_table_cams: Array  # (n, 4, 4) of each frame's camera; the table's top is z = 0

    @classmethod
    def read(cls, root: GraspNetRoot, files: SceneFiles, exact: bool) -> "SceneTruth":
        """Read the data that all frames of a scene share."""
        return cls(root, files, exact, files.cam0_wrt_table @ files.camera_poses)

    def frame(self, frame_id: int) -> tuple[list[int], GridScene | ExactScene]:
        """Return the ids of a frame's objects, in the annotation's order, and its scene."""
        if frame_id >= len(self.T_table_cams):
            path = self.files.camera_folder / "camera_poses.npy"
            raise FormatError(
                path, f"holds {len(self.T_table_cams)} poses", f"frame {frame_id} has none"
            )
        T_table_cam = self.T_table_cams[frame_id]
        listed = self._poses(self.files.frame(frame_id))
        ids = [pose.object_id for pose in listed]
        if self.exact:
            solids = [solid_object(self.root, i) for i in ids]
            exact_poses = [pose.T_cam_obj for pose in listed]
            return ids, ExactScene(solids, exact_poses, T_table_cam, self._walls)
        grids = [grid_object(self.root, i) for i in ids]
        poses = [pose.T_cam_obj.astype(np.float32) for pose in listed]
        return ids, GridScene(grids, poses, T_table_cam, self._wall_points)

    @functools.cached_property
    def _walls(self) -> list[MeshCollider]:
        return [MeshCollider(each) for each in self.files.surroundings]

    @functools.cached_property
    def _wall_points(self) -> Array:
        """Voxel means of points on the surroundings, in the form of graspnetAPI's objects."""
        rng = np.random.default_rng(self.files.scene_id)
        points = [sample_surface(m, NUM_CLOUD_SAMPLES, rng)[0] for m in self.files.surroundings]
        return voxel_means(np.concatenate(points)) if points else np.zeros((0, 3))

    def _poses(self, frame: FrameFiles) -> list[ObjectPose]:
        """Return poses; graspnetAPI takes the XML's four decimals and ignores the .mat."""
        if self.exact:
            return self.root.read_annotation(frame)
        return read_annotation_xml(frame.path("annotations"))


def object_files(root: GraspNetRoot, object_id: int, *, exact: bool) -> tuple[Path, ...]:
    """Return the files of an object's shape: its points, and its surface or grid."""
    surface = _surface(root, object_id)
    if exact:
        return (surface,)
    stored = root.textured_path(object_id, ".sdf")
    return (root.model_path(object_id), stored if stored.is_file() else surface)


def grid_object(root: GraspNetRoot, object_id: int) -> GridObject:
    """Return an object as graspnetAPI has it: its model's vertices, and `textured.sdf`.

    Without that file the grid is computed from the mesh and rounded to the file's six digits,
    which decide on flat faces.
    """
    return _grid_object(*map(FileVersion.of, object_files(root, object_id, exact=False)))


def solid_object(root: GraspNetRoot, object_id: int) -> SolidObject:
    """Return the exact object, with points all over its surface that assign grasps to it."""
    return _solid_object(*map(FileVersion.of, object_files(root, object_id, exact=True)), object_id)


@functools.lru_cache(maxsize=KEPT_OBJECTS)
def _grid_object(model: FileVersion, grid: FileVersion) -> GridObject:
    points = voxel_means(read_vertices(model.path))
    if grid.path.suffix == ".sdf":
        return GridObject(points, read_sdf(grid.path))
    return GridObject(points, as_stored(single_precision_grid(read_mesh(grid.path))))


@functools.lru_cache(maxsize=KEPT_OBJECTS)
def _solid_object(surface: FileVersion, seed: int) -> SolidObject:
    mesh = read_solid_mesh(surface.path)
    samples = sample_surface(mesh, NUM_CLOUD_SAMPLES, np.random.default_rng(seed))[0]
    return SolidObject(voxel_means(samples), mesh, MeshCollider(mesh))


def _surface(root: GraspNetRoot, object_id: int) -> Path:
    """Return the mesh that grids are made of, else the model that every root has."""
    textured = root.textured_path(object_id, ".obj")
    return textured if textured.is_file() else root.model_path(object_id)


class InputDigests:
    """Digests of all inputs that decide the verdicts on a scene; each mesh is read once."""

    def __init__(self, root: GraspNetRoot, *, exact: bool) -> None:
        self._root, self._exact = root, exact
        self._digest = functools.cache(digest_if_there)

    def of(self, dumped: DumpedScene) -> dict[str, str]:
        """Return digests of a scene's dump, poses and meshes; an absent file counts as absent."""
        files = SceneFiles(self._root.scene_folder(dumped.scene_id), dumped.scene_id, dumped.camera)
        return {
            "dump": digest_folder(dumped.folder, "*.npy"),
            "poses": self._poses(files),
            "meshes": self._meshes(files),
        }

    def _poses(self, files: SceneFiles) -> str:
        kinds = {"annotations": "*.xml"} | ({"meta": "*.mat"} if self._exact else {})
        parts = [digest_folder(files.camera_folder / kind, glob) for kind, glob in kinds.items()]
        cameras = ("camera_poses.npy", "cam0_wrt_table.npy")
        parts += [self._digest(files.camera_folder / name) for name in cameras]
        around = files.surroundings_path
        parts += [self._digest(around)] if around.is_file() else []
        images = files.image_ids  # decide which frames count, if not all have an image
        parts += [str(images)] if images and set(files.ids_of("annotations")) - {*images} else []
        return digest_text("".join(parts))

    def _meshes(self, files: SceneFiles) -> str:
        paths = [
            path
            for object_id in annotated_ids(files.camera_folder / "annotations")
            for path in object_files(self._root, object_id, exact=self._exact)
        ]
        return digest_text("".join(f"{path.name} {self._digest(path)}\n" for path in paths))
