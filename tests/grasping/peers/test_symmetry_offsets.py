"""Symmetries put together from perfect and from wrong predictions of points."""

import numpy as np
import pytest

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.peers.symmetry_offsets import SymmetryOffsets, symmetries_by_offsets
from tests.geometry.tabletops import Box
from tests.grasping.seen_regions import seen

POSE, SCENE, REGION = seen([Box((0.06, 0.09, 0.1))])
MIDDLE = transform_points(POSE, [0, 0, 0.05])
POINTS = REGION.points[::10]
PLANES = [ReflectionSymmetry(POSE[:3, axis], MIDDLE) for axis in range(3)]
AXIS = RotationSymmetry(POSE[:3, 2], MIDDLE)


def perfect(noise=0.0):
    """Return predictions of points that know three planes, an axis and the centre."""
    rng = np.random.default_rng(0)
    mirrored = np.stack([plane.counterpart(POINTS) - POINTS for plane in PLANES], axis=1)
    foot = 0.5 * (AXIS.counterpart(POINTS) - POINTS)
    parts = [MIDDLE - POINTS, mirrored, foot]
    parts = [each + noise * rng.normal(size=each.shape) for each in parts]
    existence = np.tile([0.9, 0.8, 0.1], (len(POINTS), 1))
    return SymmetryOffsets(POINTS, *parts, existence, np.array([0.1, 0.2, 0.3, 0.4]))


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_symmetries_that_the_points_agree_on_are_returned(noise):
    found = symmetries_by_offsets(perfect(noise), SCENE)
    for slot, plane in enumerate([*PLANES, AXIS]):
        cosine = abs(found.direction[slot] @ plane.direction)
        assert np.arccos(min(cosine, 1.0)) < 1e-3 + 10 * noise
        offset = found.point[slot] - plane.point
        away = offset @ plane.direction if slot < 3 else np.cross(offset, plane.direction)
        assert np.linalg.norm(away) < 1e-6 + noise
    np.testing.assert_allclose(found.point[4], MIDDLE, atol=1e-6 + noise)
    assert isinstance(found.symmetry(4), SphereSymmetry)


def test_confidence_is_the_probability_times_the_share_that_agrees():
    found = symmetries_by_offsets(perfect(), SCENE)
    assert found.probability[0] == pytest.approx(0.9, abs=0.05)
    assert found.probability[2] == pytest.approx(0.1, abs=0.01)
    assert found.probability[3] == pytest.approx(0.5, abs=0.05)
    assert found.probability[4] == pytest.approx(0.4)


def test_points_that_disagree_give_no_confidence():
    predicted = perfect()
    rng = np.random.default_rng(0)
    wild = SymmetryOffsets(
        predicted.points,
        *(
            rng.normal(scale=0.1, size=each.shape)
            for each in (predicted.center, predicted.mirrored)
        ),
        rng.normal(scale=0.1, size=predicted.axis_foot.shape),
        predicted.existence,
        predicted.mode,
    )
    found = symmetries_by_offsets(wild, SCENE)
    assert (found.probability < 0.1).all()
    assert np.isfinite(found.point).all()


def test_a_plane_whose_images_would_be_seen_is_refuted():
    predicted = perfect()
    aside = MIDDLE + 0.1 * POSE[:3, 0] - POINTS  # next to the box, over the bare table
    wrong = SymmetryOffsets(
        predicted.points,
        aside,
        predicted.mirrored,
        predicted.axis_foot,
        predicted.existence,
        predicted.mode,
    )
    assert symmetries_by_offsets(wrong, SCENE).probability[0] < 0.5 * 0.9
