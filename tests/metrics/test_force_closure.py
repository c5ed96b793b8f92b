"""Force closure: the closed form against the sweep, known values, laws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.geometry.transforms import unit
from pipelines.grasping.grasps import GraspPoses
from pipelines.metrics.contacts import Contacts, close_fingers
from pipelines.metrics.force_closure import (
    FRICTION_GRID,
    friction_of_cosine,
    min_friction,
    on_grid,
    quality,
)
from tests.metrics.shapes import box

few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)
FINE_GRID = np.linspace(0.02, 2.0, 100).tolist()


def is_force_closure(contacts, friction_coef):
    angles = np.arccos(np.clip(contacts.cosines, -1.0, 1.0))
    return contacts.found & (angles <= np.arctan(friction_coef)).all(axis=1)


def friction_sweep(contacts, grid=FRICTION_GRID):
    smallest = np.full(len(contacts.found), np.inf)
    for friction_coef in sorted(grid, reverse=True):
        smallest[is_force_closure(contacts, friction_coef)] = friction_coef
    return smallest


def random_contacts(rng: np.random.Generator, count: int = 60) -> Contacts:
    """Pairs whose outward normals point away from each other, more or less."""
    points = rng.normal(size=(count, 2, 3))
    line = unit(points[:, 1] - points[:, 0])
    outward = np.stack([-line, line], 1)
    spread = rng.choice([0.05, 0.3, 1.5], (count, 1, 1))
    normals = unit(outward + spread * rng.normal(size=(count, 2, 3)))
    return Contacts(points, normals, rng.random(count) < 0.9)


@given(seeds, st.sampled_from([FRICTION_GRID, FINE_GRID, (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)]))
@few
def test_the_closed_form_equals_the_sweep(seed, grid):
    contacts = random_contacts(np.random.default_rng(seed))
    assert_array_equal(on_grid(min_friction(contacts), grid), friction_sweep(contacts, grid))


def test_a_cosine_rounded_above_one_needs_no_friction():
    assert friction_of_cosine(np.array([np.nextafter(1.0, 2.0)])).tolist() == [0.0]


@given(seeds)
@few
def test_a_finer_grid_never_needs_more_friction(seed):
    contacts = random_contacts(np.random.default_rng(seed))
    finer = (*FRICTION_GRID, *(step - 0.05 for step in FRICTION_GRID))
    assert (friction_sweep(contacts, finer) <= friction_sweep(contacts)).all()
    assert (min_friction(contacts) <= friction_sweep(contacts, finer)).all()


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.5, 0.78])
def test_a_grasp_turned_on_a_slab_needs_the_tangent_of_the_angle(angle):
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    grasp = GraspPoses(turn, np.zeros(3), np.array(0.05))
    contacts = close_fingers(box(0.2, 0.04, 0.2), grasp, 0.12)
    assert_allclose(min_friction(contacts), np.tan(angle), atol=1e-7)
    assert_allclose(quality(min_friction(contacts)), 1 - np.tan(angle), atol=1e-7)


def test_contacts_that_face_the_same_way_are_never_in_force_closure():
    contacts = Contacts(
        np.array([[[0.0, 0, 0], [0, 1, 0]]]),
        np.array([[[0.0, -1, 0], [0, -1, 0]]]),
        np.array([True]),
    )
    assert min_friction(contacts).tolist() == [np.inf]
    assert friction_sweep(contacts).tolist() == [np.inf]


def test_a_friction_equal_to_the_grid_value_is_enough():
    assert on_grid([0.0, 0.1, 0.10001, 1.0, 1.01, np.inf]).tolist() == [
        0.1, 0.1, 0.2, 1.0, np.inf, np.inf,
    ]  # fmt: skip


def test_quality_is_zero_without_contact_beyond_friction_one_and_in_collision():
    friction = [0.25, 1.0, 1.1, np.inf, 0.25]
    failed = [False, False, False, False, True]
    assert quality(friction, failed).tolist() == [0.75, 0.0, 0.0, 0.0, 0.0]
