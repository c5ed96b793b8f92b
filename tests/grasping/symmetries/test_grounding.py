"""Predicted symmetries are fitted to a rendered region and get a confidence."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import make_pose, unit
from pipelines.grasping.symmetries.grounding import ground_symmetries
from pipelines.inference import models
from tests.grasping.symmetries.views import view_of, view_of_box

CRITICS = models.symmetry_critics()


def disturbed(symmetry, degrees, rng):
    shift = rng.normal(0, 0.004, 3)
    turned = unit(symmetry.direction + np.tan(np.radians(degrees)) * unit(rng.normal(size=3)))
    field = "axis" if symmetry.kind == "rotation" else "normal"
    return replace(symmetry, **{field: turned, "point": symmetry.point + shift})


@pytest.fixture(scope="module")
def can():
    return view_of(trimesh.creation.cylinder(0.03, 0.1, sections=64))


@pytest.fixture(scope="module")
def box():
    return view_of_box()


def uncertain(symmetries):
    slots = SymmetrySlots.from_symmetries(symmetries)
    full = [np.where(np.isnan(part), 0.5, part) for part in (slots.point, slots.direction)]
    return SymmetrySlots(
        np.full(5, 0.45), full[0] * [[0, 0, 1]], np.apply_along_axis(unit, 1, full[1])
    )


def test_the_axis_of_a_can_is_found_and_believed(can):
    scene, region, pose = can
    truth = RotationSymmetry([0, 0, 1], [0, 0, 0]).transformed(pose)
    slots = uncertain([disturbed(truth, 15, np.random.default_rng(0))])
    slots.point[:] = truth.point
    found = ground_symmetries(slots, region, scene, CRITICS)
    assert found.probability[3] > 0.5
    assert abs(float(found.direction[3] @ truth.axis)) > np.cos(np.radians(3))


def test_a_box_has_planes_but_no_axis(box):
    scene, region, pose = box
    turned = pose @ make_pose(np.eye(3), [0, 0, 0])
    angle = 0.6
    across = ReflectionSymmetry([np.cos(angle), np.sin(angle), 0], [0, 0, 0]).transformed(turned)
    slots = uncertain([disturbed(across, 8, np.random.default_rng(1))])
    slots.point[:] = across.point
    found = ground_symmetries(slots, region, scene, CRITICS)
    assert found.probability[3] < 0.5
    believed = [k for k in range(3) if found.probability[k] > 0.5]
    assert any(
        abs(float(found.direction[k] @ across.normal)) > np.cos(np.radians(6)) for k in believed
    )


def test_a_plane_that_throws_images_into_free_space_is_not_believed(can):
    scene, region, pose = can
    beside = ReflectionSymmetry([1, 0, 0], [0.03, 0, 0]).transformed(pose)
    slots = uncertain([beside])
    slots.point[:] = beside.point
    found = ground_symmetries(slots, region, scene, CRITICS)
    for slot in range(3):
        offset = abs(float((found.point[slot] - pose[:3, 3]) @ found.direction[slot]))
        assert found.probability[slot] < 0.5 or offset < 0.012


def test_each_symmetry_names_network_or_shape_as_its_source(box):
    scene, region, pose = box
    across = ReflectionSymmetry([1, 0, 0], [0, 0, 0]).transformed(pose)
    slots = uncertain([across])
    slots.point[:] = across.point
    for candidates in ("network", "shape"):
        found = ground_symmetries(slots, region, scene, CRITICS, candidates)
        assert set(found.source[found.probability > 0]) == {candidates}
    found = ground_symmetries(slots, region, scene, CRITICS)
    assert set(found.source) <= {"network", "shape", "both"}
    assert len(set(found.source)) > 1
