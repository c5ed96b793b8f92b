"""The share of the finger tips' space that the camera sees to be free."""

import itertools

import numpy as np
import pytest

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import random_rotation
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.visibility import PLACES, TIP_LENGTH, visible_fraction
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.scene import SceneCloud

CAMERA = Intrinsics(400.0, 400.0, 159.5, 119.5, 320, 240)
GRIPPER = load_gripper("rg2")


def wall(distance, left=None):
    """A scene of a wall across the view, its left half at `left` metres if that is given."""
    depth = np.full((240, 320), float(distance))
    if left is not None:
        depth[:, :160] = left
    return SceneCloud(depth, CAMERA)


def along_the_view(z, width=0.04):
    """A grasp whose finger tips end at depth `z`, the fingers left and right of the middle."""
    rotation = np.column_stack([[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]])
    reach = GRIPPER.tip_reach
    return GraspPoses(rotation[None], np.array([[0, 0, z - reach]]), np.array([width]))


@pytest.mark.parametrize(
    ("scene", "share"),
    [
        (wall(0.6), 1.0),  # in front of the wall
        (wall(0.4), 0.0),  # behind it
        (wall(0.6, left=0.4), 0.5),  # one finger is hidden
        (wall(0.0), 0.0),  # nothing was measured
    ],
)
def test_space_in_front_of_a_surface_is_seen_and_space_behind_it_is_not(scene, share):
    assert visible_fraction(along_the_view(0.5), GRIPPER, scene)[0] == pytest.approx(share)


def test_a_finger_tip_that_reaches_into_the_wall_is_seen_in_part():
    shares = [
        visible_fraction(along_the_view(z), GRIPPER, wall(0.5))[0] for z in (0.49, 0.515, 0.54)
    ]
    assert shares[0] == 1.0
    assert 0.2 < shares[1] < 0.8
    assert shares[2] == 0.0


def test_space_outside_the_image_and_behind_the_camera_is_not_seen():
    grasp, metre = along_the_view(0.5), np.eye(3)
    beside = GraspPoses(grasp.rotation, grasp.translation + metre[:1], grasp.width)
    behind = GraspPoses(grasp.rotation, grasp.translation - metre[2:], grasp.width)
    assert visible_fraction(beside, GRIPPER, wall(0.6))[0] == 0.0
    assert visible_fraction(behind, GRIPPER, wall(0.6))[0] == 0.0
    assert visible_fraction(GraspPoses.empty(), GRIPPER, wall(0.6)).shape == (0,)


def test_the_share_equals_that_of_a_lattice_of_points():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.45, 0.55, (240, 320)) * (rng.uniform(size=(240, 320)) < 0.9)
    scene = SceneCloud(depth, CAMERA)
    place = np.column_stack([rng.uniform(-0.2, 0.2, (40, 2)), rng.uniform(-0.1, 0.6, 40)])
    rotation = np.stack([random_rotation(rng) for _ in place])
    grasps = GraspPoses(rotation, place, rng.uniform(0.01, 0.08, 40))
    expected = []
    for index in range(len(grasps)):
        free = []
        for low, high in GRIPPER.boxes(grasps.width[index])[:2]:
            low[0] = max(low[0], high[0] - TIP_LENGTH)
            for share in itertools.product(PLACES, repeat=3):
                point = rotation[index] @ (low + share * (high - low)) + place[index]
                (u, v), inside = (found[0] for found in CAMERA.pixels_of(point[None]))
                free.append(inside and point[2] < depth[v, u])
        expected.append(np.mean(free))
    np.testing.assert_allclose(visible_fraction(grasps, GRIPPER, scene), expected)
