"""Symmetries by fitting alone, on half-seen shapes whose symmetries are known."""

import numpy as np
import pytest

from pipelines.geometry.transforms import transform_points, unit
from pipelines.grasping.scene import RegionCloud
from pipelines.grasping.symmetries.by_fitting import ACCEPTED, symmetries_by_fitting
from tests.geometry.tabletops import Ball, Box, Can
from tests.grasping.seen_regions import seen

NEAR, DEGREES = 0.002, 2.0  # metres; the error that half-seen perfect shapes leave


def angle_between(a, b):
    return np.degrees(np.arccos(min(1.0, abs(float(unit(a) @ unit(b))))))


def has_plane(found, normal, point):
    """Return whether `found` accepts the plane through `point`."""
    return any(
        angle_between(plane.normal, normal) < DEGREES
        and abs((plane.point - point) @ plane.normal) < NEAR
        for _, plane in found.between(ACCEPTED)
        if plane.kind == "reflection"
    )


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_an_upright_plane_of_a_half_seen_box_is_found(yaw):
    pose, scene, region = seen([Box((0.1, 0.06, 0.08), yaw=yaw)])
    found = symmetries_by_fitting(region, scene)
    across = pose[:3, :3] @ [np.cos(yaw), np.sin(yaw), 0.0]
    assert has_plane(found, across, transform_points(pose, [0, 0, 0.04]))


def test_the_axis_of_a_half_seen_cylinder_is_found_and_a_plane_through_it():
    pose, scene, region = seen([Can(0.04, 0.12)])
    found, middle = symmetries_by_fitting(region, scene), transform_points(pose, [0, 0, 0.06])
    axis = found.symmetry(3)
    assert found.probability[3] > ACCEPTED
    assert angle_between(axis.axis, pose[:3, 2]) < DEGREES
    assert np.linalg.norm(np.cross(axis.point - middle, pose[:3, 2])) < NEAR
    planes = [plane for slot, plane in found.between(ACCEPTED) if slot < 3]
    assert planes
    assert all(abs(plane.normal @ pose[:3, 2]) < np.sin(np.radians(DEGREES)) for plane in planes)


def test_the_centre_of_a_half_seen_ball_is_found():
    pose, scene, region = seen([Ball(0.04, (0.0, 0.0, 0.04))])
    found = symmetries_by_fitting(region, scene)
    assert found.probability[4] > ACCEPTED
    assert np.linalg.norm(found.point[4] - transform_points(pose, [0, 0, 0.04])) < NEAR


def test_neither_box_nor_cylinder_is_a_sphere_and_a_box_has_no_axis():
    for shape in (Box((0.1, 0.06, 0.08), yaw=0.5), Can(0.04, 0.12)):
        _, scene, region = seen([shape])
        found = symmetries_by_fitting(region, scene)
        assert found.probability[4] < ACCEPTED
        assert found.probability[3] < ACCEPTED or isinstance(shape, Can)


def test_a_random_blob_has_no_accepted_symmetry():
    rng = np.random.default_rng(0)
    pose, scene, _ = seen([Box((0.1, 0.06, 0.08))])
    local = rng.uniform([-0.05, -0.05, 0.01], [0.05, 0.05, 0.11], (800, 3))
    points = transform_points(pose, local)
    blob = RegionCloud(points, unit(rng.normal(size=(800, 3))), np.zeros(scene.depth.shape, bool))
    assert not symmetries_by_fitting(blob, scene).between(ACCEPTED)


def test_the_table_side_of_a_plane_costs_confidence():
    """Images beneath the table cannot be real."""
    _, scene, region = seen([Box((0.1, 0.06, 0.08), yaw=0.5)])
    raised = scene.plane.__class__(scene.plane.normal, scene.plane.offset - 0.05)
    lifted = scene.__class__(scene.depth, scene.intrinsics, raised)
    best = [symmetries_by_fitting(region, each).probability[:3].max() for each in (scene, lifted)]
    assert best[1] < best[0]
