"""Cutting objects into symmetric regions."""

import numpy as np

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.symmetric_parts import components, symmetric_regions
from pipelines.geometry.symmetry_detection import analyse
from tests.geometry.symmetric_shapes import ball_beside_box, box, pebble

QUICK = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)


def regions_of(mesh):
    rng = np.random.default_rng(0)
    detection = analyse(mesh, QUICK, rng)
    return detection.symmetries, symmetric_regions(mesh, detection, QUICK, rng)


def test_an_object_with_global_symmetry_is_one_region():
    symmetries, (whole,) = regions_of(box())
    assert whole.name == "whole"
    assert whole.symmetries == symmetries
    assert len(whole.triangles) == len(box().faces)


def test_an_object_with_nothing_symmetric_is_one_region_without_symmetries():
    symmetries, (whole,) = regions_of(pebble())
    assert symmetries == whole.symmetries == []


def test_a_ball_beside_a_box_is_a_sphere_and_a_region_of_three_planes():
    symmetries, regions = regions_of(ball_beside_box())
    assert symmetries == []
    kinds = [[symmetry.kind for symmetry in region.symmetries] for region in regions]
    assert ["sphere"] in kinds
    assert any(found.count("reflection") == 3 for found in kinds)


def test_regions_do_not_share_triangles():
    _, regions = regions_of(ball_beside_box())
    triangles = np.concatenate([region.triangles for region in regions])
    assert len(np.unique(triangles)) == len(triangles)


def test_components_are_the_connected_parts():
    mesh = ball_beside_box()
    parts = components(mesh, np.arange(len(mesh.faces)))
    assert len(parts) == 2
    vertices = [set(mesh.faces[part].ravel()) for part in parts]
    assert not vertices[0] & vertices[1]
