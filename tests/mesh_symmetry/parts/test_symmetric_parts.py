"""Cutting objects into symmetric regions."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.mesh_symmetry.detection.symmetry_detection import analyse, holding
from pipelines.mesh_symmetry.doubt import Gauge
from pipelines.mesh_symmetry.parts import symmetric_parts
from pipelines.mesh_symmetry.parts.part_symmetries import PartSymmetries
from pipelines.mesh_symmetry.parts.sampled_parts import SampledParts
from pipelines.mesh_symmetry.parts.symmetric_parts import symmetric_regions
from pipelines.synthesis.objects.families.catalogue import make_shape
from tests.geometry.symmetric_shapes import (
    ball_beside_box,
    box,
    box_at,
    cylinder,
    finned_box,
    l_shape,
    pebble,
    pronged_column,
    three_boxes,
)

QUICK = AnnotateSymmetryConfig(
    num_samples=8000, num_verification_samples=1000, plane_directions=400, axis_directions=250
)


def regions_of(mesh):
    rng = np.random.default_rng(0)
    detection = analyse(mesh, QUICK, rng)
    return detection.symmetries, symmetric_regions(mesh, detection, QUICK, rng)


def regions_without(dropped, mesh):
    """The regions of `mesh` if a person dropped the symmetries `dropped`."""
    rng = np.random.default_rng(0)
    detection = replace(analyse(mesh, QUICK, rng), symmetries=[], dropped=tuple(dropped))
    return symmetric_regions(mesh, detection, QUICK, rng)


def kinds(region):
    return [symmetry.kind for symmetry in region.symmetries]


def axis_of(region):
    (axis,) = [symmetry for symmetry in region.symmetries if symmetry.kind == "rotation"]
    return axis


@pytest.fixture(scope="module")
def mug():
    """A cup about z with a handle toward +x."""
    return make_shape("mug", np.random.default_rng(3)).solid.mesh()


@pytest.fixture(scope="module")
def regions_of_mug(mug):
    return regions_of(mug)[1]


def test_what_is_drawn_for_later_parts_does_not_depend_on_the_whole_object():
    rng = np.random.default_rng(0)
    detection = replace(analyse(l_shape(), QUICK, rng), symmetries=[])
    parts = SampledParts.of(l_shape(), symmetric_parts.NUM_SAMPLES, rng)
    search, before = PartSymmetries(parts, detection, QUICK, rng, 1.0), rng.bit_generator.state
    assert search.part(np.ones(symmetric_parts.NUM_SAMPLES, bool)) == []
    assert rng.bit_generator.state != before


def test_an_object_with_mirror_planes_is_one_region():
    symmetries, (whole,) = regions_of(box())
    assert whole.name == "whole"
    assert whole.symmetries == tuple(symmetries)
    assert len(whole.triangles) == len(box().faces)


def test_an_asymmetric_object_is_one_region_without_symmetries():
    symmetries, (whole,) = regions_of(pebble())
    assert (symmetries, whole.symmetries) == ([], ())


def test_a_mug_is_a_body_of_revolution_and_a_handle(mug, regions_of_mug):
    body, handle = regions_of_mug
    assert abs(axis_of(body).axis[2]) > np.cos(np.radians(0.5))
    radius = np.linalg.norm(mug.triangles.mean(axis=1)[:, :2] - axis_of(body).point[:2], axis=1)
    outside = radius > np.percentile(radius[body.triangles], 99.0) + 0.004
    assert set(np.flatnonzero(outside)) <= set(handle.triangles)
    assert mug.face_areas[handle.triangles].sum() < 0.15 * mug.area


def test_a_handle_has_the_mirror_plane_of_its_mug(regions_of_mug):
    planes = [plane for plane in regions_of_mug[1].symmetries if plane.kind == "reflection"]
    assert max(abs(plane.normal[1]) for plane in planes) > np.cos(np.radians(1.0))


def test_regions_move_with_their_object(mug, regions_of_mug):
    pose = make_pose(random_rotation(np.random.default_rng(5)), np.array([0.3, -0.2, 1.0]))
    moved = regions_of(mug.transformed(pose))[1]
    assert [region.name for region in moved] == [region.name for region in regions_of_mug]
    for region, before in zip(moved, regions_of_mug, strict=True):
        both = np.intersect1d(region.triangles, before.triangles)
        either = np.union1d(region.triangles, before.triangles)
        assert mug.face_areas[both].sum() > 0.95 * mug.face_areas[either].sum()
    turned = axis_of(regions_of_mug[0]).transformed(pose)
    assert_allclose(abs(axis_of(moved[0]).axis @ turned.axis), 1.0, atol=1e-4)


def test_a_body_is_found_behind_the_hole_of_its_handle(mug, regions_of_mug):
    body = mug.submesh(regions_of_mug[0].triangles)
    angle = np.arctan2(*body.triangles.mean(axis=1)[:, [1, 0]].T)
    height = body.triangles.mean(axis=1)[:, 2]
    window = (np.abs(angle) < 0.5) & (np.abs(height - height.mean()) < 0.02)
    regions = regions_of(body.submesh(~window))[1]
    assert any("rotation" in kinds(region) for region in regions)


def test_a_hexagonal_column_is_no_body_of_revolution():
    prism = make_shape("polygon_prism", np.random.default_rng(101)).solid.mesh()
    symmetries, (whole,) = regions_of(prism)
    assert whole.name == "whole"
    assert all(getattr(symmetry, "order", 0) is not None for symmetry in symmetries)


def test_a_ball_and_a_box_are_a_sphere_and_a_region_of_three_planes():
    symmetries, regions = regions_of(ball_beside_box())
    assert symmetries == []
    assert ["sphere"] in [kinds(region) for region in regions]
    assert any(kinds(region).count("reflection") == 3 for region in regions)


def test_regions_do_not_share_triangles(regions_of_mug):
    triangles = np.concatenate([region.triangles for region in regions_of_mug])
    assert len(np.unique(triangles)) == len(triangles)


def test_triangles_turned_inside_out_do_not_change_the_regions(mug, regions_of_mug):
    turned = np.random.default_rng(0).uniform(size=len(mug.faces)) < 0.3
    faces = np.where(turned[:, None], mug.faces[:, ::-1], mug.faces)
    regions = regions_of(Mesh(mug.vertices, faces))[1]
    assert [region.name for region in regions] == [region.name for region in regions_of_mug]
    assert abs(axis_of(regions[0]).axis @ axis_of(regions_of_mug[0]).axis) > 0.9999


@cache
def regions_of_shape(shape):
    return regions_of(shape())[1]


@pytest.mark.parametrize("shape", [pronged_column, finned_box])
def test_the_planes_of_a_part_hold_on_the_whole_part_with_their_stated_error(shape):
    mesh = shape()
    regions = [region for region in regions_of_shape(shape) if region.name != "whole"]
    assert any("reflection" in kinds(region) for region in regions)
    for region in regions:
        gauge = Gauge.of(mesh.submesh(region.triangles), QUICK, np.random.default_rng(1))
        for plane in region.symmetries:
            if plane.kind == "reflection":
                measure = gauge.measure(plane)
                assert measure.strain < 1.2
                assert_allclose(plane.error, measure.error, atol=0.003)


def test_a_fin_that_breaks_the_symmetry_of_a_part_is_in_no_region():
    mesh = finned_box()
    (part,) = regions_of_shape(finned_box)
    assert kinds(part).count("reflection") == 3
    fin = np.flatnonzero(mesh.triangles.mean(axis=1)[:, 1] > 0.041)
    assert not np.intersect1d(part.triangles, fin).size


def test_only_true_planes_of_the_offered_ones_hold_with_their_measured_error():
    middle, beside = np.zeros(3), np.array([0.0, 0.01, 0.0])
    offered = [
        ReflectionSymmetry(normal, point, 0.5)
        for normal, point in [(np.eye(3)[1], beside), (np.eye(3)[2], middle)]
    ]
    (held,) = holding(offered, box(), QUICK, np.random.default_rng(0))
    assert_allclose(held.normal, np.eye(3)[2])
    assert held.error < 0.005


@pytest.mark.parametrize("shape", [box, cylinder])
def test_no_region_brings_back_what_was_dropped_from_the_whole(shape):
    (whole,) = regions_without(regions_of(shape())[0], shape())
    assert (whole.name, whole.symmetries) == ("whole", ())


def test_an_object_without_its_dropped_symmetries_is_cut_into_its_symmetric_parts():
    regions = regions_without(regions_of(l_shape())[0], l_shape())
    fewer, more = sorted(kinds(region).count("reflection") for region in regions)
    assert fewer >= 1
    assert more >= 2


def test_a_part_that_is_nearly_the_whole_does_not_bring_back_what_was_dropped():
    dropped = [ReflectionSymmetry(normal, np.zeros(3)) for normal in np.eye(3)[:2]]
    mesh = finned_box()
    for region in regions_without(dropped, mesh):
        if mesh.face_areas[region.triangles].sum() > 0.95 * mesh.area:
            for plane in region.symmetries:
                assert plane.kind != "reflection" or abs(plane.normal[2]) > 0.99


def test_a_body_that_is_nearly_the_whole_does_not_bring_back_a_dropped_axis():
    knob = box_at((0.01, 0.01, 0.008), (0.03, 0.0, 0.01))
    can = cylinder()
    corners = np.concatenate([can.vertices, knob.vertices])
    mesh = Mesh(corners, np.concatenate([can.faces, knob.faces + len(can.vertices)]))
    assert any("rotation" in kinds(region) for region in regions_without([], mesh))
    axis = RotationSymmetry(np.eye(3)[2], np.zeros(3))
    for region in regions_without([axis], mesh):
        assert "rotation" not in kinds(region)


def test_a_part_with_hardly_a_triangle_of_a_coarse_mesh_has_no_symmetry():
    mesh = three_boxes()
    for region in regions_of(mesh)[1]:
        if region.symmetries:
            assert mesh.face_areas[region.triangles].sum() > 0.03 * mesh.area


def test_an_oval_column_stays_whole_and_gets_no_axis():
    column = cylinder()
    oval = Mesh(column.vertices * (1.0, 0.94, 1.0), column.faces)
    symmetries, (whole,) = regions_of(oval)
    assert whole.name == "whole"
    assert whole.symmetries == tuple(symmetries)
    assert all(symmetry.order is not None for symmetry in symmetries if symmetry.kind == "rotation")


def test_the_distance_from_a_hull_of_many_faces_is_taken_some_faces_at_a_time(monkeypatch):
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(400, 3)), rng.normal(size=(50, 3))
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    whole = symmetric_parts._outside(corners, points)
    assert_allclose(whole, np.linalg.norm(points, axis=1) - 1.0, atol=0.05)
    monkeypatch.setattr(symmetric_parts, "FACES_AT_A_TIME", 7)
    assert_allclose(symmetric_parts._outside(corners, points), whole, atol=1e-12)
