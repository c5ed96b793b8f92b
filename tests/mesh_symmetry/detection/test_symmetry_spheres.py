"""Detection of balls, hollow balls, and shapes that are neither."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.symmetry import RotationSymmetry
from pipelines.mesh_symmetry.detection.symmetry_detection import analyse_body, detect_symmetries
from tests.geometry.symmetric_shapes import ball, cylinder, hollow_ball

QUICK = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)
Z = np.eye(3)[2]


def kinds(mesh):
    return [s.kind for s in detect_symmetries(mesh, QUICK, np.random.default_rng(0))]


@pytest.mark.parametrize("wall", [0.0005, 0.0033, 0.01])
def test_a_hollow_ball_is_a_sphere(wall):
    (found,) = detect_symmetries(hollow_ball(0.033, wall), QUICK, np.random.default_rng(0))
    assert found.kind == "sphere"
    assert_allclose(found.point, 0.0, atol=0.0005)
    assert found.error < 0.02


def test_a_body_with_the_shape_of_a_hollow_ball_is_a_sphere():
    guess = RotationSymmetry(Z, np.zeros(3))
    (found,) = analyse_body(hollow_ball(), guess, QUICK, np.random.default_rng(0))
    assert found.kind == "sphere"


@pytest.mark.parametrize("wall", [0.0, 0.0033])
def test_a_deep_bowl_has_only_its_axis(wall):
    whole = hollow_ball(0.033, wall) if wall else ball(0.033)
    bowl = whole.submesh(whole.triangles.mean(axis=1)[:, 2] > -0.0165)
    assert "sphere" not in kinds(bowl)
    assert "rotation" in kinds(bowl)


def test_neither_a_drum_nor_an_egg_is_a_sphere():
    egg = ball(0.033)
    stretched = type(egg)(egg.vertices * (1.0, 1.0, 1.25), egg.faces)
    for mesh in (cylinder(0.03, 0.06), stretched):
        assert "sphere" not in kinds(mesh)
