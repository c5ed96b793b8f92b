"""Orientation of triangles of closed and open meshes, from rays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.winding import looks_inward, turned_outward
from tests.metrics.shapes import ball, box


def flipped(mesh: Mesh, which) -> Mesh:
    which = np.broadcast_to(which, len(mesh.faces))
    return replace(mesh, faces=np.where(which[:, None], mesh.faces[:, ::-1], mesh.faces))


SOLIDS = {"box": box(0.04, 0.05, 0.06), "ball": ball(0.04)}


@pytest.mark.parametrize("name", SOLIDS)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), missing=st.floats(0.0, 0.3), turned=st.floats(0.0, 1.0))
def test_exactly_the_turned_triangles_look_inward_where_a_mesh_has_holes(
    name, seed, missing, turned
):
    rng = np.random.default_rng(seed)
    solid = SOLIDS[name]
    left = rng.random(len(solid.faces)) >= missing
    left[: len(left) // 2] = True
    scan = solid.submesh(left)
    which = rng.random(len(scan.faces)) < turned
    np.testing.assert_array_equal(looks_inward(flipped(scan, which)), which)


def test_each_part_of_a_mesh_is_turned_by_its_own_rays():
    parts = [SOLIDS["box"], replace(SOLIDS["ball"], vertices=SOLIDS["ball"].vertices + 0.2)]
    first, second = len(parts[0].faces), len(parts[1].faces)
    mixed = Mesh.concatenate([parts[0], flipped(parts[1], True)])
    np.testing.assert_array_equal(looks_inward(mixed), np.repeat([False, True], [first, second]))


def test_the_wall_of_a_closed_hollow_looks_into_it():
    hollow = flipped(replace(SOLIDS["box"], vertices=0.5 * SOLIDS["box"].vertices), True)
    shell = Mesh.concatenate([SOLIDS["box"], hollow])
    assert not looks_inward(shell).any()
    assert looks_inward(flipped(shell, True)).all()  # it follows the outer wall


def test_a_single_sheet_is_not_turned():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    leaf = Mesh(square, [[0, 1, 2], [0, 2, 3]])
    for sheet in (leaf, flipped(leaf, True)):
        assert not looks_inward(sheet).any()
    assert looks_inward(flipped(leaf, [True, False])).sum() == 1  # its halves agree at least


def test_a_moebius_strip_does_not_loop_forever():
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    half = np.stack([np.cos(around / 2) * np.cos(around), np.cos(around / 2) * np.sin(around),
                     np.sin(around / 2)], 1)  # fmt: skip
    middle = np.stack([np.cos(around), np.sin(around), np.zeros(24)], 1)
    vertices = np.concatenate([middle + 0.3 * half, middle - 0.3 * half])
    i = np.arange(24)
    j = (i + 1) % 24
    above = np.where(j == 0, j + 24, j), np.where(j == 0, j, j + 24)
    faces = np.concatenate([np.stack([i, above[0], i + 24], 1),
                            np.stack([above[0], above[1], i + 24], 1)])  # fmt: skip
    assert looks_inward(Mesh(vertices, faces)).shape == (48,)


def test_a_few_folded_triangles_give_no_warning():
    sphere = SOLIDS["ball"]
    smallest = np.argmin(sphere.face_areas)
    folded = flipped(sphere, np.arange(len(sphere.faces)) == smallest)
    mesh, note = turned_outward(folded)
    assert (mesh is folded, note) == (True, "")


def test_turned_triangles_are_reported():
    sphere = SOLIDS["ball"]
    mesh, note = turned_outward(flipped(sphere, True))
    np.testing.assert_array_equal(np.sort(mesh.faces, axis=1), np.sort(sphere.faces, axis=1))
    assert not looks_inward(mesh).any()
    assert note == "turned its triangles, which looked inward"
    half = np.arange(len(sphere.faces)) % 2 == 0
    mesh, note = turned_outward(flipped(sphere, half))
    assert not looks_inward(mesh).any()
    assert note == f"turned {half.sum()} of its {len(half)} triangles, which looked inward"
