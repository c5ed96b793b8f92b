"""The ground truth of a frame of a GraspNet root, as input of the metrics."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.configs import EvaluateConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles, split_of_scene
from pipelines.dataset.meshes import read_solid_mesh
from pipelines.dataset.symmetry.regioned_objects import read_regioned_object
from pipelines.dataset.training import affordance_labels
from pipelines.dataset.training.affordance_labels import AffordanceLabels
from pipelines.errors import FormatError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import sample_surface
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.region_masks import RegionInstance, visible_regions
from pipelines.geometry.transforms import rotate_vectors, transform_points
from pipelines.metrics.grasp_verdicts import TrueObject, TrueScene
from pipelines.metrics.mesh_collision import MeshCollider
from pipelines.metrics.symmetry_matching import TrueRegion

SURFACE_POINTS = 20000  # one point per 2 mm on an object of the size of a hand
ERROR_POINTS = 500  # points of a region that the dense symmetry error is averaged over
MIN_ERROR_POINTS = 20  # fewer points do not span a region


@dataclass(frozen=True)
class FrameTruth:
    """The ground truth of one frame."""

    split: str  # seen, similar, novel or train
    intrinsics: Intrinsics
    label: NDArray[np.uint8 | np.uint16]  # (H, W) object id + 1, 0 = background
    visible: list[int]  # ids of the objects that count, ascending
    scene: TrueScene  # meshes, poses, table, surroundings
    instances: list[RegionInstance]  # visible symmetric regions, with their masks
    regions: list[TrueRegion]  # the same regions, as input of the symmetry metrics


@dataclass
class TruthReader:
    """Reads frames of a root; objects are read once and kept."""

    root: GraspNetRoot
    config: EvaluateConfig
    _objects: dict[int, TrueObject] = field(default_factory=dict)
    _affordance: dict[int, AffordanceLabels] = field(default_factory=dict)
    _scenes: dict[SceneFiles, tuple[Intrinsics, list[MeshCollider]]] = field(default_factory=dict)

    def read(self, files: FrameFiles) -> FrameTruth:
        """Read one frame.

        Raises:
            FormatError: the label image has another size than the depth images of the scene.
        """
        label = self.root.read_label(files)
        poses = {p.object_id: p.T_cam_obj for p in self.root.read_annotation(files)}
        scene_files = self.root.scene(files.scene_id, files.camera)
        table = scene_files.table_from_camera(files.frame_id)
        intrinsics, around = self._camera_and_surroundings(scene_files)
        if label.shape != (intrinsics.height, intrinsics.width):
            found = f"the label image is {label.shape[1]}x{label.shape[0]}"
            expected = f"the depth images are {intrinsics.width}x{intrinsics.height}"
            raise FormatError(files.path("label"), found, expected)
        scene = TrueScene({i: self.object(i) for i in poses}, poses, table, around)
        counts = np.bincount(label.ravel(), minlength=max(poses, default=0) + 2)
        visible = [i for i in sorted(poses) if counts[i + 1] >= self.config.min_visible_pixels]
        instances = self._instances(label, intrinsics, poses, visible)
        regions = [
            TrueRegion(region_points(instance, scene, intrinsics), tuple(instance.symmetries))
            for instance in instances
        ]
        split = split_of_scene(files.scene_id)
        return FrameTruth(split, intrinsics, label, visible, scene, instances, regions)

    def object(self, object_id: int) -> TrueObject:
        """Return an object's mesh, surface points and collider."""
        if object_id not in self._objects:
            mesh = read_solid_mesh(self.root.model_path(object_id))
            rng = np.random.default_rng(object_id)
            points, normals, _ = sample_surface(mesh, SURFACE_POINTS, rng)
            self._objects[object_id] = TrueObject(mesh, points, normals, MeshCollider(mesh))
        return self._objects[object_id]

    def affordance(self, object_id: int) -> AffordanceLabels:
        """Return the affordance of an object that `refine-grasps` wrote."""
        if object_id not in self._affordance:
            path = affordance_labels.current_path(self.root, object_id)
            self._affordance[object_id] = affordance_labels.read(path)
        return self._affordance[object_id]

    def _instances(
        self,
        label: NDArray[np.uint8 | np.uint16],
        intrinsics: Intrinsics,
        poses: dict[int, Array],
        visible: list[int],
    ) -> list[RegionInstance]:
        """Return the regions of visible objects that have `min_visible_pixels` or more."""
        objects = {i: read_regioned_object(self.root.root, i) for i in visible}
        found = visible_regions(label, intrinsics, sorted(poses.items()), objects)
        return [i for i in found if i.mask.sum() >= self.config.min_visible_pixels]

    def _camera_and_surroundings(self, scene: SceneFiles) -> tuple[Intrinsics, list[MeshCollider]]:
        if scene not in self._scenes:
            around = [MeshCollider(each) for each in scene.surroundings]
            self._scenes[scene] = scene.intrinsics, around
        return self._scenes[scene]


def region_points(instance: RegionInstance, scene: TrueScene, intrinsics: Intrinsics) -> Array:
    """Return (n, 3) points, camera frame, of the object's true surface that represent a region.

    These points face the camera and project into the region's mask, also where the object itself
    hides them. If they are too few, points of the whole object are returned.
    """
    target, pose = scene.objects[instance.object_id], scene.poses[instance.object_id]
    points, normals = transform_points(pose, target.points), rotate_vectors(pose, target.normals)
    pixels, inside = intrinsics.pixels_of(points)
    inside &= np.einsum("ni,ni->n", points, normals) < 0
    inside[inside] = instance.mask[pixels[inside, 1], pixels[inside, 0]]
    seen = points[inside] if inside.sum() >= MIN_ERROR_POINTS else points
    return strided_at_least(seen, ERROR_POINTS)
