"""Convex pieces of meshes: meshes that are cut, and meshes that are their convex hull."""

import numpy as np
import pytest
import trimesh

from pipelines.geometry.meshes import convex_decomposition
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.synthesis.objects.decomposition import (
    OPEN_SEARCH,
    physics_pieces,
    without_small_holes,
)

BOX = trimesh.creation.box((0.06, 0.04, 0.1))
VERTICES, FACES = np.asarray(BOX.vertices), np.asarray(BOX.faces)


def refuse(*_args):
    raise AssertionError("a convex solid needs no cut")


@pytest.mark.parametrize(
    "faces",
    [
        FACES[1:],
        FACES[2:],
        np.vstack([[[1, 0, 0]], FACES[1:]]),
        FACES[[*range(1, 7), *range(8, 12)]],
    ],
    ids=["a triangle", "a square", "a triangle without area", "two triangles"],
)
def test_the_piece_of_a_convex_solid_without_a_triangle_or_two_is_its_hull(faces, monkeypatch):
    monkeypatch.setattr(convex_decomposition, "decomposed", refuse)
    (piece,) = physics_pieces(Mesh(VERTICES, faces))
    assert piece.volume == pytest.approx(BOX.volume)


def test_filled_holes_face_outward_and_large_holes_stay():
    filled = without_small_holes(Mesh(VERTICES, FACES[1:]))
    assert filled.is_watertight
    assert filled.volume == pytest.approx(BOX.volume)
    ball = trimesh.creation.icosphere(2, 0.03)
    is_kept = (ball.triangles[:, :, 2] < 0.02).all(axis=1)
    bowl = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces[is_kept]))
    assert len(without_small_holes(bowl).faces) == len(bowl.faces)


def test_open_surfaces_are_cut_by_a_short_search(monkeypatch):
    given = []

    def pieces(_mesh, settings):
        given.append(settings)
        return []

    monkeypatch.setattr(convex_decomposition, "decomposed", pieces)
    wrong = FACES.copy()
    wrong[3, 1] = next(k for k in range(8) if k not in FACES[3])  # joins corners far apart
    physics_pieces(Mesh(VERTICES, wrong))
    ring = trimesh.creation.annulus(0.02, 0.04, 0.02)
    physics_pieces(Mesh(np.asarray(ring.vertices), np.asarray(ring.faces)))
    broken, whole = given
    assert broken == whole | OPEN_SEARCH
    assert not whole.keys() & OPEN_SEARCH.keys()
