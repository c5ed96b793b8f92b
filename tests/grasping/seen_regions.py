"""Rendered shapes on a table, as a scene and a region of it."""

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ReflectionSymmetry, SymmetrySlots
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.scene import RegionCloud, SceneCloud
from tests.geometry.tabletops import CAMERA, looking_at_table, render


def scene_of(depth, pose, camera=CAMERA):
    """The scene of a depth image of the table; `pose` maps the table frame to the camera's."""
    return SceneCloud(depth, camera, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))


def seen(shapes, pose=None):
    """The table's pose, the scene of `shapes` on it, and the region of the first shape."""
    pose = looking_at_table() if pose is None else pose
    depth, index = render(shapes, pose)
    scene = scene_of(depth, pose)
    return pose, scene, RegionCloud.from_mask(index == 0, scene)


def believed(*symmetries, confidence=1.0):
    """Symmetries in their slots: planes first, each with the same confidence."""
    slots = {"reflection": 0, "rotation": 3, "sphere": 4}
    placed = []
    for symmetry in symmetries:
        placed.append((slots[symmetry.kind], symmetry, confidence))
        slots[symmetry.kind] += 1
    return SymmetrySlots.of(placed)


def box_planes(pose, height):
    """The two upright planes of a box of `height` in the middle of the table."""
    middle = transform_points(pose, [0, 0, height / 2])
    return believed(*(ReflectionSymmetry(pose[:3, axis], middle) for axis in (0, 1)))
