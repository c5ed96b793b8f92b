"""Building blocks: closed, with the volume of their formulas and pieces that cover them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.geometry.transforms import random_rotation
from pipelines.synthesis.objects.revolved import hollow_lathe, lathe, pipe, torus
from pipelines.synthesis.objects.solids import (
    MAX_FACES,
    ball,
    bent_tube,
    box,
    cut_layers,
    lump,
    prism,
    rounded_box,
    rounded_polyline,
)

SIZE = (0.06, 0.04, 0.1)
LINE = np.column_stack([np.linspace(-0.05, 0.05, 11), np.zeros(11), np.zeros(11)])
SECTION = 0.01 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
SOLIDS = {
    "box": (lambda: box(SIZE), 2.4e-4),
    "ball": (lambda: ball(0.03), 4 / 3 * np.pi * 0.03**3),
    "cylinder": (lambda: lathe([(0, 0), (0.03, 0), (0.03, 0.1), (0, 0.1)]), np.pi * 0.03**2 * 0.1),
    "cone": (lambda: lathe([(0, 0), (0.03, 0), (0, 0.1)]), np.pi * 0.03**2 * 0.1 / 3),
    "pipe": (lambda: pipe(0.04, 0.03, 0.05, 0.0002), np.pi * (0.04**2 - 0.03**2) * 0.05),
    "torus": (lambda: torus(0.04, SECTION), 2 * np.pi * 0.04 * 2e-4),
    "prism": (lambda: prism([(0, 0), (0.05, 0), (0, 0.03)], 0.1), 7.5e-5),
    "rod": (lambda: bent_tube(LINE, np.full(11, 0.01), sides=64), np.pi * 0.01**2 * 0.1),
    "egg": (lambda: lump(0.03, (1.5, 1, 1), []), 4 / 3 * np.pi * 0.03**3 * 1.5),
    "cup": (
        lambda: hollow_lathe(
            [(0, 0), (0.03, 0), (0.03, 0.06)], [(0.027, 0.06), (0.027, 0.004), (0, 0.004)]
        ),
        np.pi * (0.03**2 * 0.06 - 0.027**2 * 0.056),
    ),
}
# Made for each test: solids that live until exit make their library warn of leaks.
every_solid = pytest.mark.parametrize("name", SOLIDS)


@every_solid
def test_volume_equals_the_formula(name):
    make, volume = SOLIDS[name]
    assert make().body.volume() == pytest.approx(volume, rel=0.01)


@every_solid
def test_mesh_is_closed_and_keeps_the_volume(name):
    solid = SOLIDS[name][0]()
    mesh = solid.mesh()
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(solid.body.volume(), rel=1e-6)


@every_solid
def test_mesh_has_vertices_on_flat_faces_within_its_budget(name):
    mesh = SOLIDS[name][0]().mesh()
    edges = np.linalg.norm(np.diff(mesh.triangles[:, [0, 1, 2, 0]], axis=1), axis=-1)
    assert edges.max() < 0.02
    assert len(mesh.faces) <= MAX_FACES * 1.05


@every_solid
def test_pieces_stay_within_the_bounds(name):
    solid = SOLIDS[name][0]()
    low, high = solid.mesh().bounds
    points = np.concatenate(solid.pieces)
    assert (points >= low - 1e-6).all()
    assert (points <= high + 1e-6).all()


@given(st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_moving_moves_the_surface_and_the_pieces_together(seed):
    rng = np.random.default_rng(seed)
    R, t = random_rotation(rng), rng.normal(size=3)
    moved = box(SIZE).moved(R, t)
    assert moved.body.volume() == pytest.approx(2.4e-4)
    assert_allclose(moved.pieces[0], box(SIZE).pieces[0] @ R.T + t, atol=1e-12)


def test_union_and_difference_obey_inclusion_and_exclusion():
    one, other = box(SIZE), box(SIZE).moved(translation=(0.03, 0.0, 0.0))
    assert (one | other).body.volume() == pytest.approx(1.5 * 2.4e-4)
    assert (one - other).body.volume() == pytest.approx(0.5 * 2.4e-4)
    assert len((one | other).pieces) == 2
    assert len((one - other).pieces) == 1


def test_a_mirrored_solid_is_still_turned_outward():
    wedge = prism([(0, 0), (0.05, 0), (0, 0.03)], 0.1)
    mirrored = wedge.moved(np.diag([-1.0, 1.0, 1.0]))
    assert mirrored.mesh().volume == pytest.approx(7.5e-5, rel=1e-5)
    assert mirrored.mesh().bounds[0, 0] == pytest.approx(-0.05, abs=1e-8)


def test_bevels_and_roundings_remove_a_little_and_keep_the_extent():
    for cut in (box(SIZE, 0.002), rounded_box(SIZE, 0.005)):
        assert 0.9 * 2.4e-4 < cut.body.volume() < 2.4e-4
        assert_allclose(np.ptp(cut.mesh().bounds, axis=0), SIZE, atol=2.5e-4)


def test_layers_overlap_and_leave_no_gap():
    points = np.random.default_rng(0).uniform(size=(2000, 3))
    parts = cut_layers(points, 2, 4)
    assert len(parts) == 4
    assert {tuple(p) for p in points} == {tuple(p) for part in parts for p in part}
    assert sum(len(part) for part in parts) > 2000


def test_rounding_keeps_ends_and_stays_near_the_corners():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    line = rounded_polyline(corners, 0.1)
    assert_array_equal(line[[0, -1]], corners[[0, -1]])
    gap = np.linalg.norm(line[:, None] - corners[None], axis=-1).min(axis=0)
    assert gap.max() < 0.1
    assert gap[1] > 0.01
