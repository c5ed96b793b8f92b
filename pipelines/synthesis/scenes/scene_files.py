"""Writer of one synthetic scene in GraspNet-1Billion's layout."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import SynthesizeConfig
from pipelines.dataset import convex_pieces as convex_file
from pipelines.dataset.graspnet.graspnet import GraspNetRoot, write_depth
from pipelines.dataset.graspnet.graspnet import write_label as write_label_image
from pipelines.dataset.graspnet.graspnet_label_stream import read_grasp_label
from pipelines.dataset.graspnet.graspnet_labels import (
    LabelledGrasps,
    chosen_grasps,
    write_collision_labels,
    write_rect,
)
from pipelines.dataset.graspnet.graspnet_layout import (
    IMAGE_KINDS,
    SURROUNDINGS_FILE,
    SceneFiles,
)
from pipelines.dataset.meshes import read_mesh
from pipelines.dataset.scene_digests import CAMERA_FILES, POSES
from pipelines.errors import SymgraspError, counted
from pipelines.frames.graspnet_scene import (
    ObjectPose,
    write_annotation,
    write_meta,
    write_object_ids,
    write_pose_array,
)
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import invert
from pipelines.storage.array_files import write_npy
from pipelines.storage.files import atomic_folder
from pipelines.storage.images import write_image
from pipelines.storage.provenance import Stamp, remove_stamped, stamp_ahead, write_sidecar
from pipelines.synthesis.labels.grasp_sampling import scene_collisions
from pipelines.synthesis.labels.planar_labels import planar_rows
from pipelines.synthesis.scenes.cameras import (
    MIXED,
    camera_folder,
    drawn_viewpoints,
    sensor_intrinsics,
)
from pipelines.synthesis.scenes.depth_sensors import SENSORS
from pipelines.synthesis.scenes.tables import SceneLayout, SceneObject, View, drawn_layout, record

TAG_SCENE, TAG_SENSOR = 2, 4  # purposes of child seeds


def files_of_scene(
    root: GraspNetRoot, scene_id: int, config: SynthesizeConfig, seed: int
) -> tuple[Path, ...]:
    """Return the files without which scene `scene_id` is not whole."""
    camera = camera_folder(_sensor_of(config, scene_id, seed))
    scene = SceneFiles(root.scene_folder(scene_id), scene_id, camera)
    frames = [scene.frame(frame_id) for frame_id in range(config.views)]
    found = [frame.path(kind) for frame in frames for kind in (*IMAGE_KINDS, *POSES)]
    found += [scene.camera_folder / name for name in CAMERA_FILES]
    found += [scene.folder / name for name in ("object_id_list.txt", "rs_wrt_kn.npy")]
    if _has_collision_labels(config):
        found.append(root.collision_label_path(scene_id))
        found += [frame.path("rect") for frame in frames]
    return tuple(found)


def write_scene(
    root: GraspNetRoot,
    scene_id: int,
    members: Sequence[int],
    config: SynthesizeConfig,
    stamp: Stamp,
) -> str:
    """Draw scene `scene_id` of the objects `members` and write all its files; return a note."""
    rng = np.random.default_rng([stamp.seed, TAG_SCENE, scene_id])
    layout = _draw_layout(root, config, members, rng)
    sensor = _sensor_of(config, scene_id, stamp.seed)
    intrinsics = sensor_intrinsics(sensor, config.width, config.height)
    around = layout.surroundings
    viewpoints = drawn_viewpoints(
        layout.center, config.views, intrinsics, rng, around.arc, around.elevations
    )
    free: list[LabelledGrasps] = []
    if _has_collision_labels(config):
        free = _write_collisions(root, scene_id, layout, stamp)
    else:  # earlier labels belong to the scene that this one replaces
        remove_stamped(root.collision_label_path(scene_id))
    with atomic_folder(root.scene_folder(scene_id)) as folder:
        views = record(layout, viewpoints, intrinsics, sensor, rng, config.scenery)
        write_views(folder, camera_folder(sensor), views, layout, viewpoints, intrinsics, free)
        write_sidecar(folder, stamp)
    return f"{counted(len(layout.objects), 'object')}, {counted(config.views, 'view')}"


def write_views(
    folder: Path,
    camera_name: str,
    views: Iterable[View],
    layout: SceneLayout,
    viewpoints: Array,
    intrinsics: Intrinsics,
    free: Sequence[LabelledGrasps] = (),
) -> None:
    """Write a scene to `folder`: `views` of `layout` from `viewpoints` (n, 4, 4), T_table_cam.

    `camera_name`: kinect or realsense. `free`: grasps of each object for planar labels, if any.
    """
    write_object_ids(folder / "object_id_list.txt", [o.object_id for o in layout.objects])
    write_pose_array(folder / "rs_wrt_kn.npy", np.tile(np.eye(4), (len(viewpoints), 1, 1)))
    if layout.surroundings.solids:
        convex_file.write(folder / SURROUNDINGS_FILE, layout.surroundings.solids)
    camera = folder / camera_name
    write_npy(camera / "camK.npy", intrinsics.matrix)
    write_pose_array(camera / "camera_poses.npy", invert(viewpoints[0]) @ viewpoints)
    write_pose_array(camera / "cam0_wrt_table.npy", viewpoints[0])
    for frame_id, view in enumerate(views):
        _write_view(camera, frame_id, view, layout, intrinsics, free)


def _has_collision_labels(config: SynthesizeConfig) -> bool:
    return config.collision_labels and config.labels.num_points > 0


def _sensor_of(config: SynthesizeConfig, scene_id: int, seed: int) -> str:
    if config.sensor != MIXED:
        return config.sensor
    return str(np.random.default_rng([seed, TAG_SENSOR, scene_id]).choice(list(SENSORS)))


def _draw_layout(
    root: GraspNetRoot, config: SynthesizeConfig, members: Sequence[int], rng: np.random.Generator
) -> SceneLayout:
    if not members:
        raise SymgraspError("no objects to make scenes of; give --models a folder of meshes")
    count = min(int(rng.integers(config.min_objects, config.max_objects + 1)), len(members))
    drawn = rng.choice(members, count, replace=False)
    objects = []
    for object_id in drawn.tolist():
        model = root.model_path(object_id)
        pieces = convex_file.read(model.parent / "convex.npz")
        objects.append(SceneObject(object_id, f"{object_id:03d}", read_mesh(model), pieces))
    return drawn_layout(objects, config.scenery.surroundings, rng)


def _write_view(
    camera: Path,
    frame_id: int,
    view: View,
    layout: SceneLayout,
    intrinsics: Intrinsics,
    free: Sequence[LabelledGrasps],
) -> None:
    """Write the files of one view, with planar labels of each object's `free` grasps, if any."""
    name = f"{frame_id:04d}"
    object_ids = np.array([item.object_id for item in layout.objects])
    label = np.where(view.object_index >= 0, object_ids[view.object_index] + 1, 0)
    poses = [
        ObjectPose(item.object_id, invert(view.T_world_cam) @ pose, item.name)
        for item, pose in zip(layout.objects, layout.poses, strict=True)
    ]
    write_image(camera / "rgb" / f"{name}.png", view.color)
    write_depth(camera / "depth" / f"{name}.png", view.depth)
    write_label_image(camera / "label" / f"{name}.png", label)
    write_annotation(camera / "annotations" / f"{name}.xml", poses)
    write_meta(camera / "meta" / f"{name}.mat", poses, intrinsics.matrix)
    if free:
        T_cam_obj = invert(view.T_world_cam) @ layout.poses
        rows = [
            planar_rows(object_id, grasps, pose, intrinsics)
            for object_id, grasps, pose in zip(object_ids.tolist(), free, T_cam_obj, strict=True)
        ]
        write_rect(camera / "rect" / f"{name}.npy", np.concatenate(rows))


def _write_collisions(
    root: GraspNetRoot, scene_id: int, layout: SceneLayout, stamp: Stamp
) -> list[LabelledGrasps]:
    """Write the collision labels; return each object's grasps that hold without collision."""
    labels = [read_grasp_label(root.grasp_label_path(item.object_id)) for item in layout.objects]
    meshes = [item.mesh for item in layout.objects]
    around = layout.surroundings.solids
    collisions = scene_collisions(labels, meshes, list(layout.poses), surroundings=around)
    target = root.collision_label_path(scene_id)
    stamp_ahead(target, stamp)
    write_collision_labels(target, collisions)
    return [
        chosen_grasps(label, (label.min_friction > 0) & ~collision)
        for label, collision in zip(labels, collisions, strict=True)
    ]
