"""Doubt of an annotation: how near its decisions were to the opposite one."""

import numpy as np
import pytest
import trimesh

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.mesh_symmetry.doubt import Gauge

QUICK = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)
X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)


def gauge_of(shape):
    mesh = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
    return Gauge.of(mesh, QUICK, np.random.default_rng(0))


@pytest.fixture(scope="module")
def box():
    return gauge_of(trimesh.creation.box((0.12, 0.06, 0.04)))


@pytest.fixture(scope="module")
def hexagon():
    return gauge_of(trimesh.creation.cylinder(0.03, 0.06, sections=6))


def tilted(degrees):
    turn = np.radians(degrees)
    return ReflectionSymmetry([np.cos(turn), np.sin(turn), 0.0], ORIGIN)


def test_an_exact_symmetry_has_no_doubt(box):
    planes = [ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)]
    assert max(box.measure(plane).strain for plane in planes) < 0.2
    assert box.assess([*planes, RotationSymmetry(X, ORIGIN, 2)], []).doubt < 0.3


def test_strain_grows_with_the_tilt_and_passes_1_where_the_symmetry_ends(box):
    strains = [box.measure(tilted(degrees)).strain for degrees in (0, 1, 3, 6, 12)]
    assert strains == sorted(strains)
    assert strains[0] < 1 < strains[-1]


def test_an_accepted_plane_at_the_limit_is_as_doubtful_as_a_rejected_one(box):
    near = next(plane for plane in map(tilted, np.arange(0, 9, 0.25))
                if box.measure(plane).strain > 0.9)  # fmt: skip
    assert box.assess([near], []).doubt > 0.9
    assert box.assess([], [near]).doubt > 0.7
    assert box.assess([], [tilted(40)]).doubt < 0.4


def test_a_candidate_close_to_an_accepted_symmetry_is_passed_over(box):
    plane = ReflectionSymmetry(X, ORIGIN)
    assert box.assess([plane], [tilted(2)]).rejected == ()
    assert len(box.assess([plane], [tilted(30)]).rejected) == 1


def test_a_polygon_causes_no_doubt_about_a_round_axis(hexagon):
    round_axis = RotationSymmetry(Z, ORIGIN)
    measure = hexagon.measure(round_axis)
    assert measure.roundness < 0.5
    assert hexagon.assess([RotationSymmetry(Z, ORIGIN, 6)], [round_axis]).doubt < 0.5


def test_planes_through_a_round_axis_are_passed_over():
    can = gauge_of(trimesh.creation.cylinder(0.03, 0.1, sections=64))
    axis, plane = RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(Z, ORIGIN)
    assessment = can.assess([plane, axis], [ReflectionSymmetry(X, ORIGIN)])
    assert assessment.rejected == ()
    assert assessment.doubt < 0.5


def test_a_sphere_that_was_not_accepted_is_reported_and_doubtful():
    ball = gauge_of(trimesh.creation.icosphere(4, 0.03))
    missed = ball.assess([], [])
    assert missed.doubt > 0.9
    assert isinstance(missed.rejected[0], SphereSymmetry)
    assert ball.assess([SphereSymmetry(ORIGIN)], []).doubt < 0.3


def test_the_error_does_not_change_with_the_unit(box):
    big = gauge_of(trimesh.creation.box((120.0, 60.0, 40.0)))
    assert big.measure(tilted(5)).error == pytest.approx(box.measure(tilted(5)).error, rel=0.05)
