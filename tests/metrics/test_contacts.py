"""Contacts of closing fingers on shapes whose contacts are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, random_rotation, rotate_vectors
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.contacts import close_fingers
from tests.metrics.shapes import ball, box, moved, random_grasps

few = settings(max_examples=20, deadline=None)
seeds = st.integers(0, 2**32 - 1)

ACROSS = GraspPoses(np.eye(3), np.zeros(3), np.array(0.05))  # closes along y


def shifted(y: float) -> GraspPoses:
    return GraspPoses(np.eye(3), np.array([0.0, y, 0.0]), np.array(0.05))


def test_contacts_on_a_box_are_on_its_faces():
    contacts = close_fingers(box(0.06, 0.04, 0.1), ACROSS, 0.1)
    assert contacts.found.tolist() == [True]
    assert_allclose(contacts.points[0], [[0, -0.02, 0], [0, 0.02, 0]], atol=1e-15)
    assert_allclose(contacts.normals[0], [[0, -1, 0], [0, 1, 0]], atol=1e-15)
    assert_allclose(contacts.cosines, 1.0)


def test_a_finger_stops_at_the_midpoint():
    reached = close_fingers(box(0.06, 0.04, 0.1), shifted(0.019), 0.1)
    beyond = close_fingers(box(0.06, 0.04, 0.1), shifted(0.021), 0.1)
    assert (reached.found.tolist(), beyond.found.tolist()) == ([True], [False])


def test_a_finger_that_starts_inside_has_no_contact():
    contacts = close_fingers(box(0.06, 0.04, 0.1), ACROSS, 0.03)
    assert contacts.found.tolist() == [False]
    assert np.isnan(contacts.points).all()


def test_a_finger_that_starts_inside_a_wall_does_not_touch_the_wall_from_behind():
    walls = [moved(box(0.06, 0.02, 0.1), make_pose(np.eye(3), [0, y, 0])) for y in (-0.05, 0.03)]
    inside = close_fingers(Mesh.concatenate(walls), ACROSS, 0.1)
    assert inside.found.tolist() == [False]


def test_a_grasp_next_to_the_object_has_no_contact():
    beside = GraspPoses(np.eye(3), np.array([0.2, 0.0, 0.0]), np.array(0.05))
    assert close_fingers(box(0.06, 0.04, 0.1), beside, 0.1).found.tolist() == [False]


def test_contacts_on_a_ball_lie_on_it():
    rng = np.random.default_rng(3)
    contacts = close_fingers(ball(0.03), random_grasps(rng, 200, spread=0.01), 0.1)
    assert contacts.found.all()
    radius = np.linalg.norm(contacts.points, axis=-1)
    assert_allclose(radius, 0.03, rtol=0.01)  # the ball is a polyhedron


@given(seeds)
@few
def test_moving_grasps_and_mesh_moves_the_contacts(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    mesh, grasps = box(0.06, 0.04, 0.1), random_grasps(rng, 30, spread=0.03)
    here = close_fingers(mesh, grasps, 0.1)
    there = close_fingers(moved(mesh, T), grasps.transformed(T), 0.1)
    assert (here.found == there.found).mean() > 0.95  # rays that graze an edge may differ
    both = here.found & there.found
    assert_allclose(there.cosines[both], here.cosines[both], atol=1e-6)
    assert_allclose(there.normals[both], rotate_vectors(T, here.normals[both]), atol=1e-6)


def test_no_grasps_have_no_contacts():
    contacts = close_fingers(ball(0.03), GraspPoses.empty(), 0.1)
    assert contacts.points.shape == (0, 2, 3)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.6])
def test_a_grasp_turned_on_a_slab_meets_its_normals_at_that_angle(angle):
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    contacts = close_fingers(
        box(0.2, 0.04, 0.2), GraspPoses(turn, np.zeros(3), np.array(0.05)), 0.12
    )
    assert_allclose(contacts.cosines, np.cos(angle), atol=1e-9)
