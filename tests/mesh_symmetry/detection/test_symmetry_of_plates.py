"""Symmetries of closed plates, whose walls are a hundredth of their area."""

import numpy as np
import pytest

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.mesh_symmetry.detection.symmetry_detection import detect_symmetries
from tests.geometry.symmetric_shapes import box, cylinder

QUICK = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)
POSES = range(2)


def plate(sides, seed):
    """A plate of `sides` corners in a random pose and size, 0.6 % as thick as wide, and its pose.

    A wall faces along the second axis; a disc has 96 corners.
    """
    rng = np.random.default_rng(seed)
    scale, width, thickness = rng.uniform(0.5, 2.0), 0.08, 0.0005
    made = box(width, width, thickness) if sides == 4 else cylinder(width / 2, thickness, sides)
    pose = make_pose(random_rotation(rng), rng.normal(size=3))
    return Mesh(scale * made.vertices, made.faces).transformed(pose), pose


def detect(mesh):
    return detect_symmetries(mesh, QUICK, np.random.default_rng(0))


def off_axis(symmetry, pose, size):
    """The distance of a symmetry's point from the middle axis of the plate, as share of `size`."""
    arm = symmetry.point - pose[:3, 3]
    if symmetry.kind == "reflection":
        return abs(arm @ symmetry.normal) / size
    return float(np.linalg.norm(np.cross(arm, symmetry.axis))) / size


@pytest.mark.parametrize("seed", POSES)
@pytest.mark.parametrize("sides", [4, 6, 8])
def test_a_thin_plate_has_the_turns_and_planes_of_its_corners(sides, seed):
    mesh, pose = plate(sides, seed)
    found = detect(mesh)
    (axis,) = [each for each in found if each.kind == "rotation"]
    planes = [each for each in found if each.kind == "reflection"]
    assert axis.order == sides
    assert len(planes) >= 2
    assert max(off_axis(each, pose, mesh.diagonal) for each in found) < 0.002
    local = np.array([each.normal for each in planes]) @ pose[:3, :3]
    upright = local[np.abs(local[:, 2]) < 0.5]
    steps = np.arctan2(upright[:, 1], upright[:, 0]) / (np.pi / sides)
    assert np.abs(steps - np.rint(steps)).max() * 180.0 / sides < 0.5


@pytest.mark.parametrize("seed", POSES)
def test_a_thin_disc_stays_round(seed):
    mesh, pose = plate(96, seed)
    (axis,) = [each for each in detect(mesh) if each.kind == "rotation"]
    assert axis.order is None
    assert off_axis(axis, pose, mesh.diagonal) < 0.002
