"""Verdicts on predicted symmetries: right, wrong, or ignored."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.symmetry import (
    SYMMETRY_KINDS,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
)
from pipelines.geometry.transforms import make_pose, random_rotation, unit
from pipelines.metrics.average_precision import average_precision
from pipelines.metrics.symmetry_matching import (
    CORRECT,
    IGNORED,
    WRONG,
    PredictedSymmetry,
    TrueRegion,
    implied_symmetries,
    scored_symmetries,
    symmetry_verdicts,
)

few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)
X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
POINTS = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3))
THRESHOLDS = {"reflection": 0.25, "rotation": 0.25, "sphere": 0.05}


def region(*symmetries):
    return TrueRegion(POINTS, symmetries)


def judged(predicted, regions, threshold=0.25, index=0):
    predictions = [PredictedSymmetry(s, 0.9 - 0.1 * i, index) for i, s in enumerate(predicted)]
    return symmetry_verdicts(predictions, regions, threshold).tolist()


def test_the_truth_as_prediction_has_average_precision_one():
    truths = [
        region(ReflectionSymmetry(X, ORIGIN), ReflectionSymmetry(Y, ORIGIN)),
        region(RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(Z, ORIGIN)),
        region(SphereSymmetry(ORIGIN)),
        region(),
    ]
    for kind in SYMMETRY_KINDS:
        listed = [(i, s) for i, r in enumerate(truths) for s in scored_symmetries(r, kind)]
        predictions = [PredictedSymmetry(s, 0.5 + 0.01 * i, i) for i, s in listed]
        verdicts = symmetry_verdicts(predictions, truths, THRESHOLDS[kind])
        confidence = [p.confidence for p in predictions]
        assert average_precision(confidence, verdicts == CORRECT, len(listed)) == 1.0


def test_a_second_prediction_of_one_plane_is_wrong():
    plane = ReflectionSymmetry(X, ORIGIN)
    assert judged([plane, ReflectionSymmetry(-X, ORIGIN)], [region(plane)]) == [CORRECT, WRONG]


def test_a_symmetry_of_another_region_is_wrong():
    plane = ReflectionSymmetry(X, ORIGIN)
    assert judged([plane], [region(), region(plane)], index=0) == [WRONG]
    assert judged([plane], [region(), region(plane)], index=-1) == [WRONG]


def test_a_plane_through_a_continuous_axis_is_ignored():
    axis = RotationSymmetry(Z, ORIGIN)
    assert judged([ReflectionSymmetry(X, ORIGIN)], [region(axis)]) == [IGNORED]
    assert judged([ReflectionSymmetry(Z, ORIGIN)], [region(axis)]) == [WRONG]


def test_planes_and_axes_through_the_centre_of_a_sphere_are_ignored():
    ball = [region(SphereSymmetry(ORIGIN))]
    assert judged([ReflectionSymmetry(X, ORIGIN)], ball) == [IGNORED]
    assert judged([RotationSymmetry(Y, ORIGIN)], ball) == [IGNORED]
    assert judged([RotationSymmetry(Y, X * 0.2)], ball) == [WRONG]


def test_the_diagonal_planes_of_a_square_prism_are_ignored():
    prism = region(RotationSymmetry(Z, ORIGIN, order=4), ReflectionSymmetry(X, ORIGIN))
    assert judged([ReflectionSymmetry(X + Y, ORIGIN)], [prism], 0.067) == [IGNORED]
    tilted = ReflectionSymmetry([np.cos(0.4), np.sin(0.4), 0.0], ORIGIN)
    assert judged([tilted], [prism], 0.067) == [WRONG]


def test_planes_of_a_cube_that_follow_only_from_an_unlisted_axis_are_wrong():
    cube = region(
        *(ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)),
        RotationSymmetry(X, ORIGIN, order=4),
    )
    about_x = [ReflectionSymmetry(unit(n), ORIGIN) for n in (Y + Z, Y - Z)]
    assert judged(about_x, [cube]) == [IGNORED, IGNORED]
    about_others = [ReflectionSymmetry(unit(n), ORIGIN) for n in (X + Y, X - Y, X + Z, X - Z)]
    assert judged(about_others, [cube]) == [WRONG] * 4


def test_a_listed_plane_counts_once_with_or_without_a_discrete_axis():
    planes = [ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)]
    repeated = [planes[0], planes[0], planes[0]]
    for others in ((), (RotationSymmetry(Z, ORIGIN, order=2),)):
        assert judged(repeated, [region(*planes, *others)]) == [CORRECT, WRONG, WRONG]


@given(seeds)
@few
def test_planes_that_follow_from_a_turn_do_not_depend_on_the_point_of_the_listed_plane(seed):
    """A plane is given by any of its points; the axis lies in the plane, but not the point."""
    shift = np.random.default_rng(seed).normal(size=2)
    truth = region(
        ReflectionSymmetry(X, shift[0] * Y + shift[1] * Z), RotationSymmetry(Z, ORIGIN, order=4)
    )
    diagonal = ReflectionSymmetry(unit(X + Y), ORIGIN)
    assert judged([diagonal], [truth], 0.067) == [IGNORED]


def test_a_plane_within_noise_of_a_listed_one_does_not_follow_from_another():
    axis = RotationSymmetry(Z, ORIGIN, order=2)
    tilt = np.radians(4.0)
    listed = ReflectionSymmetry(np.array([-np.sin(tilt), np.cos(tilt), 0.0]), 0.003 * Y)
    assert implied_symmetries(listed, (axis, ReflectionSymmetry(X, ORIGIN), listed)) == []
    for other in (
        ReflectionSymmetry(Y, 0.006 * Y),
        ReflectionSymmetry(np.array([-np.sin(0.15), np.cos(0.15), 0.0]), ORIGIN),
    ):
        assert implied_symmetries(other, (axis, ReflectionSymmetry(X, ORIGIN), other))


def test_a_discrete_rotation_does_not_match_a_continuous_one():
    assert scored_symmetries(region(RotationSymmetry(Z, ORIGIN, order=3)), "rotation") == []


def test_a_sphere_counts_within_five_centimetres():
    ball = [region(SphereSymmetry(ORIGIN))]
    assert judged([SphereSymmetry(0.049 * X)], ball, 0.05) == [CORRECT]
    assert judged([SphereSymmetry(0.051 * X)], ball, 0.05) == [WRONG]


def test_stricter_thresholds_take_fewer_planes():
    tilt = np.radians(8.0)
    tilted = ReflectionSymmetry([np.cos(tilt), np.sin(tilt), 0.0], ORIGIN)
    truth = [region(ReflectionSymmetry(X, ORIGIN))]
    assert judged([tilted], truth, 0.25) == [CORRECT]
    assert judged([tilted], truth, 0.067) == [WRONG]


@given(seeds)
@few
def test_verdicts_do_not_depend_on_the_frame(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    truth = [ReflectionSymmetry(X, ORIGIN), ReflectionSymmetry(Y, ORIGIN)]
    predicted = [
        ReflectionSymmetry(unit(rng.normal(size=3)), 0.02 * rng.normal(size=3)) for _ in range(4)
    ]
    moved_points = POINTS @ T[:3, :3].T + T[:3, 3]
    moved = TrueRegion(moved_points, tuple(s.transformed(T) for s in truth))
    assert judged(predicted, [region(*truth)]) == judged(
        [s.transformed(T) for s in predicted], [moved]
    )


@pytest.mark.parametrize("kind", SYMMETRY_KINDS)
def test_no_predictions_give_no_verdicts(kind):
    assert symmetry_verdicts([], [region()], THRESHOLDS[kind]).shape == (0,)
