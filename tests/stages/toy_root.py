"""A dataset of a box, a can and a ball on a table whose truth and best grasps are known."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipelines.dataset.graspnet import graspnet
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.dataset.training import affordance_labels
from pipelines.dataset.training.affordance_labels import AffordanceLabels
from pipelines.frames import graspnet_scene
from pipelines.frames.graspnet_scene import ObjectPose
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.symmetry import (
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.transforms import invert, make_pose
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from pipelines.grasping.grasps import GraspPoses
from pipelines.storage.array_files import write_npy
from pipelines.storage.images import write_image
from pipelines.storage.provenance import make_stamp

Array = NDArray[np.float64]

STAMP = make_stamp("toy", {})
CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
SCENES = (100, 160)  # one of `seen`, one of `novel`
FRAMES = (0, 1)
X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
SHAPES = {
    0: trimesh.creation.box((0.06, 0.04, 0.10)),
    1: trimesh.creation.cylinder(0.025, 0.08, sections=64),
    2: trimesh.creation.icosphere(3, 0.03),
}
SYMMETRIES = {
    0: tuple(ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)),
    1: (RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(Z, ORIGIN)),
    2: (SphereSymmetry(ORIGIN),),
}
PLACES = {0: (0.0, 0.0, 0.05), 1: (0.12, 0.03, 0.04), 2: (-0.11, 0.04, 0.03)}
WIDTHS = {0: 0.04, 1: 0.05, 2: 0.06}
DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach down, closing along y


def camera_in_table(frame_id: int) -> Array:
    """`T_table_cam` of a camera half a metre away that looks at the origin from above."""
    azimuth = 0.5 + 0.7 * frame_id
    eye = 0.5 * np.array([0.6 * np.cos(azimuth), 0.6 * np.sin(azimuth), 0.8])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, Z) / np.linalg.norm(np.cross(forward, Z))
    return make_pose(np.stack([right, np.cross(forward, right), forward], 1), eye)


def write_root(folder: Path) -> GraspNetRoot:
    """Write the dataset with symmetry and affordance labels."""
    root = GraspNetRoot(folder)
    meshes = {}
    for object_id, shape in SHAPES.items():
        mesh = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
        write_mesh(root.model_path(object_id), mesh)
        meshes[object_id] = read_mesh(root.model_path(object_id))
        known = SYMMETRIES[object_id]
        whole = ObjectRegion("whole", np.arange(len(mesh.faces)), known)
        labels = ObjectSymmetries(f"{object_id:03d}", known, (whole,))
        symmetry_labels.write(root.symmetry_path(object_id), labels, STAMP)
        _write_affordance(root.affordance_path(object_id), mesh)
    for scene_id in SCENES:
        _write_scene(root, scene_id, meshes)
    return root


def _write_affordance(path: Path, mesh: Mesh) -> None:
    points, normals, _ = sample_surface(mesh, 2000, np.random.default_rng(0))
    sides = np.abs(normals[:, 2]) < 0.5  # points that a hand from above can hold
    none = np.zeros((0, 3))
    labels = AffordanceLabels(
        none[:, None, :].repeat(2, 1), none, none[:, 0], points, normals, sides
    )
    affordance_labels.write(path, labels, STAMP)


def poses_in_camera(frame_id: int) -> dict[int, Array]:
    to_camera = invert(camera_in_table(frame_id))
    return {i: to_camera @ make_pose(np.eye(3), place) for i, place in PLACES.items()}


def _write_scene(root: GraspNetRoot, scene_id: int, meshes: dict[int, Mesh]) -> None:
    folder = root.scene_folder(scene_id)
    camera = folder / "realsense"
    graspnet_scene.write_object_ids(folder / "object_id_list.txt", list(meshes))
    write_npy(camera / "camK.npy", CAMERA.matrix)
    views = np.stack([camera_in_table(frame_id) for frame_id in FRAMES])
    graspnet_scene.write_pose_array(camera / "cam0_wrt_table.npy", views[0])
    graspnet_scene.write_pose_array(camera / "camera_poses.npy", invert(views[0]) @ views)
    table = trimesh.creation.box((1.0, 1.0, 0.02))
    table_mesh = Mesh(np.asarray(table.vertices), np.asarray(table.faces))
    for frame_id in FRAMES:
        poses = poses_in_camera(frame_id)
        ground = invert(views[frame_id]) @ make_pose(np.eye(3), [0, 0, -0.01])
        scene = Scene([*meshes.values(), table_mesh], [*poses.values(), ground])
        hits = cast_view(scene, CAMERA, np.eye(4))
        files = root.scene(scene_id, "realsense").frame(frame_id)
        label = np.where(
            (hits.object_index >= 0) & (hits.object_index < 3), hits.object_index + 1, 0
        )
        graspnet.write_label(files.path("label"), label)
        graspnet.write_depth(files.path("depth"), hits.depth)
        write_image(files.path("rgb"), np.full((240, 320, 3), 128, np.uint8))
        listed = [ObjectPose(i, pose) for i, pose in poses.items()]
        graspnet_scene.write_annotation(files.path("annotations"), listed)
        graspnet_scene.write_meta(files.path("meta"), listed, CAMERA.matrix)


def best_grasp(object_id: int, frame_id: int) -> GraspPoses:
    """A grasp from above across the object's middle, camera frame: quality 1."""
    place = np.array(PLACES[object_id])
    at_table = GraspPoses(DOWN, place, np.array(WIDTHS[object_id]))
    if object_id == 0:  # fingers of 5 cm do not reach the middle of a box 10 cm high
        at_table = GraspPoses(DOWN, place + 0.03 * Z, np.array(WIDTHS[0]))
    return at_table.transformed(invert(camera_in_table(frame_id)))


def true_result(root: GraspNetRoot, name: str, objects: tuple[int, ...] = (0, 1, 2)) -> FrameResult:
    """The ground truth of `objects` in the form of a result of `infer`."""
    files = root.frame(name)
    label, poses = root.read_label(files), poses_in_camera(files.frame_id)
    slots = [
        SymmetrySlots.from_symmetries([s.transformed(poses[i]) for s in SYMMETRIES[i]])
        for i in objects
    ]
    masks = [label == i + 1 for i in objects]
    zeros, count = np.zeros(len(objects)), len(objects)
    regions = RegionTable.from_masks(
        masks,
        confidence=np.linspace(0.9, 0.8, count),
        source=["masks"] * count,
        symmetry_confidence=np.array([s.probability for s in slots]).reshape(-1, 5),
        symmetry_point=np.array([s.point for s in slots]).reshape(-1, 5, 3),
        symmetry_direction=np.array([s.direction for s in slots]).reshape(-1, 5, 3),
        affordance_mean=zeros,
        affordance_max=zeros,
    )
    grasps = GraspPoses.concatenate([best_grasp(i, files.frame_id) for i in objects])
    return FrameResult(name, "ok", "", CAMERA, 0.5, regions, grasp_table(grasps))


def grasp_table(grasps: GraspPoses) -> GraspTable:
    count = len(grasps)
    return GraspTable(
        region=np.arange(count),
        rotation=grasps.rotation,
        translation=grasps.translation,
        width=grasps.width,
        contacts=grasps.contacts,
        affordance=np.ones(count),
        symmetry_slot=np.zeros(count),
        source=np.array(["network"] * count, dtype=object),
        clearance=np.ones(count),
        enclosed_height=np.ones(count),
        rank_score=np.ones(count),
        is_best=np.ones(count, bool),
    )


def frame_names() -> list[str]:
    return [f"scenes/scene_{s:04d}/realsense/{f:04d}" for s in SCENES for f in FRAMES]


def write_grasps(path: Path, results: list[FrameResult], method: str = "network") -> None:
    grasps_file.write(path, results, make_stamp("infer", {"gripper": "rg2", "method": method}))
