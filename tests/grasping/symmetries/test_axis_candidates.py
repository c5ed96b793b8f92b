"""Axes that a region may have: of upright and lying objects, of a tin seen from above."""

import numpy as np
import pytest

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import make_pose, random_rotation, rotate_vectors, unit
from pipelines.geometry.transforms import transform_points as moved
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.axis_candidates import middle_of_outline, starting_axes
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE

NOTHING = SymmetrySlots(np.zeros(5), np.full((5, 3), 9.0), np.tile(unit([1.0, 2.0, 3.0]), (5, 1)))
TABLE = Plane(np.array([0, 0, 1.0]), 0.0)
BLANK, CAMERA = np.zeros((48, 64)), Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def starts(points, normals, table, allowed=NETWORK | SHAPE, slots=NOTHING):
    scene = SceneCloud(BLANK, CAMERA, table)
    return starting_axes(RegionEvidence(slots, points, normals, BLANK > 0, scene, allowed))


def cylinder(rng, along, center, radius=0.03, length=0.1, toward=(0.0, -0.7, 0.7)):
    """The seen half of a cylinder's wall with its axis `along` (3,) through `center` (3,)."""
    angle, height = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(-0.5, 0.5, 3000) * length
    first = unit(np.cross(along, [0.3, 0.5, 0.8]))
    second = np.cross(along, first)
    normals = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second)
    points = center + radius * normals + np.outer(height, along)
    front = normals @ unit(toward) > 0.1
    return points[front], normals[front]


def nearest(axes, direction, point, degrees):
    """Return the least distance of `point` to the axes within `degrees` of `direction`."""
    close = [a for a in axes if abs(float(a.axis @ direction)) > np.cos(np.radians(degrees))]
    return min(float(np.linalg.norm(np.cross(point - a.point, a.axis))) for a in close)


@pytest.mark.parametrize("seed", range(4))
def test_a_lying_object_turns_about_a_level_line_at_half_its_height(seed):
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, np.pi)
    along, center = np.array([np.cos(turn), np.sin(turn), 0]), np.array([0.1, 0.2, 0.03])
    points, normals = cylinder(rng, along, center)
    assert nearest(starts(points, normals, TABLE)[0], along, center, 5) < 0.006


def test_a_tin_whose_lid_alone_is_seen_turns_about_its_middle():
    rng = np.random.default_rng(0)
    flat = rng.uniform(-0.05, 0.05, (4000, 2))
    flat = flat[np.linalg.norm(flat, axis=1) < 0.05]
    flat = flat[(flat[:, 1] < 0.03)]  # another object hides a part of it
    points = np.column_stack([flat, np.full(len(flat), 0.04)])
    normals = np.tile([0, 0, 1.0], (len(points), 1))
    pose = make_pose(random_rotation(rng), rng.normal(size=3))
    axes, _ = starts(moved(pose, points), rotate_vectors(pose, normals), None)
    assert nearest(axes, pose[:3, 2], moved(pose, [0, 0, 0.04]), 2) < 0.003


def test_the_axis_that_the_network_names_comes_first():
    rng = np.random.default_rng(1)
    points, normals = cylinder(rng, np.array([0, 0, 1.0]), np.array([0, 0, 0.05]))
    axes, sources = starts(points, normals, TABLE)
    first = axes[0]
    np.testing.assert_allclose(first.axis, NOTHING.direction[3])
    np.testing.assert_allclose(first.point, NOTHING.point[3])
    assert sources[0] == NETWORK
    alone, _ = starts(points, normals, TABLE, NETWORK)
    assert len(alone) == 1
    np.testing.assert_allclose(alone[0].axis, first.axis)


def test_axes_by_shape_do_not_depend_on_the_network():
    points, normals = cylinder(np.random.default_rng(1), np.array([0, 0, 1.0]), np.zeros(3))
    elsewhere = SymmetrySlots(np.ones(5), np.full((5, 3), 3.0), np.tile([1.0, 0, 0], (5, 1)))
    found = [starts(points, normals, TABLE, SHAPE, slots) for slots in (NOTHING, elsewhere)]
    assert set(found[0][1]) == {SHAPE}
    for one, other in zip(found[0][0], found[1][0], strict=True):
        np.testing.assert_array_equal([one.axis, one.point], [other.axis, other.point])


def test_the_middle_of_an_outline_is_the_centre_of_its_circle_at_any_place():
    angle = np.linspace(0, 2 * np.pi, 100)
    ring = np.column_stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), 0.1 * angle])
    rng = np.random.default_rng(2)
    pose = make_pose(random_rotation(rng), rng.normal(size=3))
    center = middle_of_outline(moved(pose, ring), pose[:3, 2])
    assert np.linalg.norm(np.cross(center - pose[:3, 3], pose[:3, 2])) < 1e-4
