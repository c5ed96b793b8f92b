"""The verdict on a grasp in a scene of known shapes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.grasp_verdicts import TrueObject, TrueScene, grasp_verdict, qualities
from pipelines.metrics.mesh_collision import MeshCollider
from tests.metrics.shapes import ball, box, gripper, moved, surface

DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach along -z, closing along y
AT_BOX = GraspPoses(DOWN, np.array([0.0, 0.0, 0.08]), np.array(0.04))


def true_object(mesh: Mesh) -> TrueObject:
    points, normals = surface(mesh, 8000)
    return TrueObject(mesh, points, normals, MeshCollider(mesh))


OBJECTS = {0: true_object(box(0.06, 0.04, 0.1)), 1: true_object(ball(0.03))}


def scene(ball_at: tuple[float, float, float], T: np.ndarray | None = None) -> TrueScene:
    """A box that stands on the table at the origin and a ball; everything moved by `T`."""
    move = np.eye(4) if T is None else T
    poses = {
        0: move @ make_pose(np.eye(3), np.array([0, 0, 0.05])),
        1: move @ make_pose(np.eye(3), np.array(ball_at)),
    }
    return TrueScene(OBJECTS, poses, np.linalg.inv(move))


FREE = (0.3, 0.3, 0.03)


def test_a_good_grasp_holds_with_quality_one():
    verdict = grasp_verdict(scene(FREE), 0, AT_BOX, gripper())
    assert verdict.reason == "held"
    assert (verdict.quality, verdict.antipodal) == pytest.approx((1.0, 1.0))
    assert 0.5 < verdict.antipodal_region < 1.0  # the box's top is between the fingers too


def test_a_neighbour_in_a_fingers_way_is_a_collision():
    verdict = grasp_verdict(scene((0.0, 0.06, 0.08)), 0, AT_BOX, gripper())
    assert (verdict.reason, verdict.quality, verdict.antipodal_region) == ("collision", 0.0, 0.0)
    assert verdict.antipodal == pytest.approx(1.0)  # the contacts themselves are fine


def test_the_table_in_a_fingers_way_is_a_collision():
    low = GraspPoses(DOWN, np.array([0.0, 0.0, 0.003]), np.array(0.04))
    assert grasp_verdict(scene(FREE), 0, low, gripper()).reason == "collision"


def test_a_wall_in_a_fingers_way_is_a_collision_wherever_the_camera_is():
    wall = MeshCollider(moved(box(0.5, 0.05, 0.5), make_pose(np.eye(3), [0.0, 0.06, 0.0])))
    for move in (np.eye(4), make_pose(random_rotation(np.random.default_rng(1)), np.ones(3))):
        among = replace(scene(FREE, move), surroundings=[wall])
        grasp = AT_BOX.transformed(move)
        assert grasp_verdict(among, 0, grasp, gripper()).reason == "collision"
        away = replace(among, surroundings=[])
        assert grasp_verdict(away, 0, grasp, gripper()).reason == "held"


def test_a_grasp_beyond_the_opening_of_the_hand_is_too_wide():
    wide = GraspPoses(DOWN, np.array([0.0, 0.0, 0.08]), np.array(0.11))  # and a clearance of 1 cm
    verdict = grasp_verdict(scene(FREE), 0, wide, gripper())
    assert (verdict.reason, verdict.quality, verdict.antipodal_region) == ("too wide", 0.0, 0.0)


def test_fingers_close_on_an_object_that_is_wider_than_the_predicted_contacts():
    narrow = GraspPoses(DOWN, np.array([0.0, 0.0, 0.08]), np.array(0.03))  # of 4 cm, open to 5 cm
    verdict = grasp_verdict(scene(FREE), 0, narrow, gripper())
    assert (verdict.reason, verdict.quality) == ("held", pytest.approx(1.0))


def test_another_object_between_the_fingers_leaves_a_held_grasp_without_region_score():
    # A bead on the box, below the palm: only the region's score asks what else is enclosed.
    small = {**OBJECTS, 1: true_object(ball(0.005))}
    verdict = grasp_verdict(replace(scene((0.0, 0.0, 0.106)), objects=small), 0, AT_BOX, gripper())
    assert (verdict.reason, verdict.antipodal_region) == ("held", 0.0)


def test_the_nearest_object_does_not_depend_on_the_order_of_the_poses():
    given_last = scene(FREE)
    given_first = replace(given_last, poses=dict(reversed(given_last.poses.items())))
    for each in (given_last, given_first):
        assert each.nearest_object(np.array([[0.0, 0, 0.09], FREE])).tolist() == [0, 1]


def test_a_grasp_of_air_has_no_contact():
    air = GraspPoses(DOWN, np.array([0.2, 0.0, 0.2]), np.array(0.04))
    verdict = grasp_verdict(scene(FREE), 0, air, gripper())
    assert (verdict.reason, verdict.quality, verdict.min_friction) == ("no contact", 0.0, np.inf)


@pytest.mark.parametrize(
    ("length", "past", "accuracy"), [(0.05, 0.005, 1.0), (0.04, 0.005, 0.0), (0.05, 0.015, 0.0)]
)
def test_graspnets_hand_reaches_around_an_object_as_deep_as_the_fingers_allow(
    length, past, accuracy
):
    # The contacts are 4 cm below the top; fingers that reach 3.5 cm up from there do not suffice.
    low = GraspPoses(DOWN[None], np.array([[0.0, 0.0, 0.06]]), np.array([0.04]))
    hand = replace(gripper(), finger_length=length, tip_reach=past)
    np.testing.assert_array_equal(scene(FREE).accuracy(low, np.ones(1), hand)[0], accuracy)


def test_graspnets_hand_opens_by_ten_centimetres_at_most():
    # Opened by 10 cm the hand is 12 cm wide; with the clearances of our hand it would be 13 cm.
    wide = {0: true_object(box(0.06, 0.09, 0.1)), 1: OBJECTS[1]}
    among = replace(scene((0.0, 0.062 + 0.03, 0.08)), objects=wide)
    grasp = GraspPoses(DOWN[None], np.array([[0.0, 0.0, 0.08]]), np.array([0.09]))
    assert grasp_verdict(among, 0, grasp, gripper()).reason == "collision"
    np.testing.assert_array_equal(among.accuracy(grasp, np.ones(1), gripper())[0], 1.0)


def test_grasps_judged_together_have_the_same_qualities_as_alone():
    among = scene(
        (0.0, 0.06, 0.08), make_pose(random_rotation(np.random.default_rng(3)), np.ones(3))
    )
    move = np.linalg.inv(among.T_table_cam)
    heights, widths = (0.02, 0.03, 0.08, 0.08, 0.2), (0.04, 0.044, 0.04, 0.11, 0.04)
    middles = np.array([(0.02 if z == 0.03 else 0.0, 0.0, z) for z in heights])
    hands = GraspPoses(np.repeat(DOWN[None], 5, axis=0), middles, np.array(widths)).transformed(
        move
    )
    found = qualities(among, 0, hands, gripper())
    alone = [grasp_verdict(among, 0, hands[i : i + 1], gripper()) for i in range(5)]
    assert len({verdict.reason for verdict in alone}) > 2
    np.testing.assert_array_equal(found, [verdict.quality for verdict in alone])


def test_a_slanted_grasp_of_a_ball_fails_by_friction():
    above = GraspPoses(DOWN, np.array([0.3, 0.3, 0.055]), np.array(0.04))
    verdict = grasp_verdict(scene(FREE), 1, above, gripper())
    assert (verdict.reason, verdict.quality) == ("friction", 0.0)
    assert np.isfinite(verdict.min_friction)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_moving_the_whole_scene_changes_no_metric(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    turn = random_rotation(rng) if seed % 2 else DOWN
    grasp = GraspPoses(turn, np.array([0.003, 0.002, 0.08]), np.array(0.04))
    here = grasp_verdict(scene(FREE), 0, grasp, gripper())
    there = grasp_verdict(scene(FREE, T), 0, grasp.transformed(T), gripper())
    assert there.reason == here.reason
    assert there.quality == pytest.approx(here.quality, abs=1e-6)
    assert there.antipodal == pytest.approx(here.antipodal, abs=1e-6)
    assert there.antipodal_region == pytest.approx(here.antipodal_region, abs=1e-3)
