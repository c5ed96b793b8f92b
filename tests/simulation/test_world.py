"""Scenes come to rest near their poses, and no object is flung away."""

import mujoco
import numpy as np
import pytest

from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, rotation_about
from pipelines.simulation.world import add_object, at_rest, empty_world, object_pose
from tests.metrics.shapes import ball, box

CUBE = box(0.05, 0.05, 0.05)


def standing(*places: tuple[float, float, float]) -> dict[int, np.ndarray]:
    return {i: make_pose(np.eye(3), place) for i, place in enumerate(places)}


def moved(before: dict[int, np.ndarray], after: dict[int, np.ndarray]) -> np.ndarray:
    return np.array([np.linalg.norm(after[i][:3, 3] - before[i][:3, 3]) for i in before])


def test_standing_objects_stay_in_place():
    poses = standing((0, 0, 0.025), (0.1, 0, 0.025), (0, 0, 0.075))
    rested = at_rest({i: [CUBE] for i in poses}, poses)
    assert moved(poses, rested).max() < 5e-4


def test_an_empty_table_is_at_rest():
    assert at_rest({}, {}) == {}


def test_an_object_just_above_the_table_sinks_onto_it():
    poses = standing((0, 0, 0.030))
    assert at_rest({0: [CUBE]}, poses)[0][2, 3] == pytest.approx(0.025, abs=5e-4)


@pytest.mark.parametrize("overlap", [0.002, 0.02])
def test_overlapping_objects_are_separated_and_not_flung_away(overlap):
    poses = standing((0, 0, 0.025), (0.05 - overlap, 0, 0.025), (0.5, 0, 0.025))
    rested = at_rest({i: [CUBE] for i in poses}, poses)
    assert moved(poses, rested).max() < 1.5 * overlap
    assert rested[1][0, 3] - rested[0][0, 3] > 0.05 - 1e-3


def test_an_object_in_the_table_comes_up_and_does_not_jump():
    poses = standing((0, 0, 0.015))
    assert at_rest({0: [CUBE]}, poses)[0][2, 3] == pytest.approx(0.025, abs=5e-4)


def test_a_ball_does_not_roll_away():
    poses = {0: make_pose(rotation_about([1, 0, 0], 0.3), [0, 0, 0.031])}
    assert moved(poses, at_rest({0: [ball(0.03)]}, poses))[0] < 0.005


def test_pieces_without_volume_are_refused_in_a_sentence():
    sheet = Mesh(
        np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]), [[0, 1, 2], [0, 2, 3]]
    )
    with pytest.raises(SymgraspError, match="make no solid body"):
        at_rest({0: [sheet]}, standing((0, 0, 0)))


def test_objects_at_rest_stay_at_rest_without_damping():
    poses = standing((0, 0, 0.0252), (0, 0, 0.0754), (0.08, 0, 0.0247))
    rested = at_rest({i: [CUBE] for i in poses}, poses)
    spec = empty_world()
    for i, pose in rested.items():
        add_object(spec, str(i), [CUBE], pose)
    data = mujoco.MjData(model := spec.compile())
    mujoco.mj_step(model, data, nstep=1000)
    assert moved(rested, {i: object_pose(model, data, str(i)) for i in rested}).max() < 5e-4
