"""Symmetries of flat surfaces without thickness."""

import numpy as np
import pytest

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.mesh_symmetry.detection.symmetry_detection import detect_symmetries
from tests.geometry.symmetric_shapes import card, disc, sheet

QUICK = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)


def detect(mesh, seed=0):
    return detect_symmetries(mesh, QUICK, np.random.default_rng(seed))


def normals_of(symmetries):
    return np.array([s.normal for s in symmetries if s.kind == "reflection"])


def assert_along(normals, expected, degrees=0.5):
    cosine = np.abs(normals @ np.asarray(expected, float).T)
    assert len(normals) == len(expected)
    assert np.all(cosine.max(axis=0) > np.cos(np.radians(degrees)))


@pytest.mark.parametrize("size", [(0.0856, 0.054), (0.297, 0.21), (0.15, 0.05)])
def test_a_card_has_two_mirrors_and_no_continuous_axis(size):
    found = detect(card(*size))
    assert_along(normals_of(found), np.eye(3)[:2])
    assert [s.order for s in found if s.kind == "rotation"] == [2]


def test_a_card_has_the_same_symmetries_in_any_pose():
    pose = make_pose(random_rotation(np.random.default_rng(4)), np.array([0.3, -0.2, 1.0]))
    assert_along(normals_of(detect(card().transformed(pose))), pose[:3, :2].T)


def test_a_disc_keeps_its_axis():
    (axis,) = detect(disc())
    assert axis.order is None
    assert abs(axis.axis[2]) > 0.9999


def test_a_kite_has_only_the_mirror_plane_along_it():
    kite = sheet([(0.06, 0.0), (0.0, 0.03), (-0.03, 0.0), (0.0, -0.03)])
    found = detect(kite)
    assert_along(normals_of(found), [(0.0, 1.0, 0.0)])
    assert all(s.order is not None for s in found if s.kind == "rotation")
