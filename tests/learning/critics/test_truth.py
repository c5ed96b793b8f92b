"""Verdicts on candidate symmetries: near a listed one, far from all, or unknown."""

import numpy as np

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.learning.critics.truth import symmetry_truth
from pipelines.metrics.symmetry_matching import TrueRegion

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)


def tilted(degrees):
    angle = np.radians(degrees)
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def region_of(listed):
    points = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [0.03, 0.04, 0.05]
    return TrueRegion(points, tuple(listed))


def test_an_axis_is_true_near_a_listed_one_unknown_farther_off_and_false_elsewhere():
    region = region_of([RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(X, ORIGIN)])
    assert symmetry_truth(RotationSymmetry(tilted(8), ORIGIN), region) == 1.0
    assert symmetry_truth(RotationSymmetry(-Z, [0.005, 0, 5.0]), region) == 1.0
    assert np.isnan(symmetry_truth(RotationSymmetry(tilted(15), ORIGIN), region))
    assert symmetry_truth(RotationSymmetry(tilted(40), ORIGIN), region) == 0.0
    assert symmetry_truth(RotationSymmetry(Z, [0.02, 0, 0]), region) == 0.0
    assert symmetry_truth(RotationSymmetry(Z, ORIGIN), region_of([])) == 0.0


def test_an_axis_of_discrete_turns_is_no_axis_of_revolution():
    region = region_of([RotationSymmetry(Z, ORIGIN, order=4)])
    assert symmetry_truth(RotationSymmetry(Z, ORIGIN), region) == 0.0


def test_a_sphere_is_true_near_the_centre_and_every_axis_of_a_ball_is_unknown():
    ball = region_of([SphereSymmetry(ORIGIN)])
    assert symmetry_truth(SphereSymmetry([0.019, 0, 0]), ball) == 1.0
    assert symmetry_truth(SphereSymmetry([0.021, 0, 0]), ball) == 0.0
    assert symmetry_truth(SphereSymmetry(ORIGIN), region_of([RotationSymmetry(Z, ORIGIN)])) == 0.0
    assert np.isnan(symmetry_truth(RotationSymmetry(Z, ORIGIN), ball))


def test_a_plane_is_true_near_a_listed_one_unknown_farther_off_and_false_elsewhere():
    region = region_of([ReflectionSymmetry(X, ORIGIN)])
    assert symmetry_truth(ReflectionSymmetry(X, [0.001, 0, 0]), region) == 1.0
    assert np.isnan(symmetry_truth(ReflectionSymmetry(X, [0.006, 0, 0]), region))
    assert symmetry_truth(ReflectionSymmetry(X, [0.02, 0, 0]), region) == 0.0
    assert symmetry_truth(ReflectionSymmetry(Y, ORIGIN), region) == 0.0


def test_a_plane_through_the_axis_of_a_can_follows_from_it_and_has_unknown_truth():
    region = region_of([RotationSymmetry(Z, ORIGIN)])
    assert np.isnan(symmetry_truth(ReflectionSymmetry(X, ORIGIN), region))
    assert symmetry_truth(ReflectionSymmetry(Z, [0, 0, 0.03]), region) == 0.0
