"""Verdicts on candidate symmetries: near a listed one, far from all, or unknown."""

import numpy as np

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.learning.critics.truth import axis_truth, plane_truth
from pipelines.metrics.symmetry_matching import TrueRegion

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)


def tilted(degrees):
    angle = np.radians(degrees)
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def test_an_axis_is_true_within_an_angle_and_a_distance_of_a_listed_one():
    listed = [RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(X, ORIGIN)]
    assert axis_truth(RotationSymmetry(tilted(11), ORIGIN), listed) == 1.0
    assert axis_truth(RotationSymmetry(-Z, [0.007, 0, 5.0]), listed) == 1.0
    assert axis_truth(RotationSymmetry(tilted(13), ORIGIN), listed) == 0.0
    assert axis_truth(RotationSymmetry(Z, [0.009, 0, 0]), listed) == 0.0
    assert axis_truth(RotationSymmetry(Z, ORIGIN), []) == 0.0


def test_an_axis_of_discrete_turns_is_no_axis_of_revolution():
    assert axis_truth(RotationSymmetry(Z, ORIGIN), [RotationSymmetry(Z, ORIGIN, order=4)]) == 0.0


def test_a_sphere_is_true_near_the_centre_and_every_axis_of_a_ball_is_unknown():
    ball = [SphereSymmetry(ORIGIN)]
    assert axis_truth(SphereSymmetry([0.019, 0, 0]), ball) == 1.0
    assert axis_truth(SphereSymmetry([0.021, 0, 0]), ball) == 0.0
    assert axis_truth(SphereSymmetry(ORIGIN), [RotationSymmetry(Z, ORIGIN)]) == 0.0
    assert np.isnan(axis_truth(RotationSymmetry(Z, ORIGIN), ball))


def box(listed):
    points = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [0.03, 0.04, 0.05]
    return TrueRegion(points, tuple(listed))


def test_a_plane_is_true_near_a_listed_one_unknown_farther_off_and_false_elsewhere():
    region = box([ReflectionSymmetry(X, ORIGIN)])
    assert plane_truth(ReflectionSymmetry(X, [0.001, 0, 0]), region) == 1.0
    assert np.isnan(plane_truth(ReflectionSymmetry(X, [0.006, 0, 0]), region))
    assert plane_truth(ReflectionSymmetry(X, [0.02, 0, 0]), region) == 0.0
    assert plane_truth(ReflectionSymmetry(Y, ORIGIN), region) == 0.0


def test_a_plane_through_the_axis_of_a_can_follows_from_it_and_has_unknown_truth():
    region = box([RotationSymmetry(Z, ORIGIN)])
    assert np.isnan(plane_truth(ReflectionSymmetry(X, ORIGIN), region))
    assert plane_truth(ReflectionSymmetry(Z, [0, 0, 0.03]), region) == 0.0
