"""coacd in a child process: its pieces, or none if it fails or takes too long."""

import numpy as np
import pytest
import trimesh

from pipelines.geometry.meshes import convex_decomposition
from pipelines.geometry.meshes.mesh import Mesh

SETTINGS = {"threshold": 0.05, "max_convex_hull": 16, "seed": 0}


def tray() -> Mesh:
    """A box of 8 x 10 x 5.5 cm with walls of 6 mm, open at its top."""
    outer = trimesh.creation.box((0.08, 0.10, 0.055))
    inner = trimesh.creation.box((0.068, 0.088, 0.055)).apply_translation((0, 0, 0.006))
    made = trimesh.boolean.difference([outer, inner])
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def test_pieces_fill_the_walls_and_not_the_hollow():
    mesh = tray()
    pieces = convex_decomposition.decomposed(mesh, SETTINGS)
    volumes = [trimesh.convex.convex_hull(corners).volume for corners in pieces]
    assert len(pieces) >= 5  # a floor and four walls
    assert sum(volumes) == pytest.approx(mesh.volume, rel=0.05)


def test_a_child_that_dies_or_takes_too_much_cpu_time_finds_no_pieces(monkeypatch, caplog):
    monkeypatch.setattr(convex_decomposition, "CPU_LIMIT", 1)
    many = trimesh.creation.torus(0.05, 0.01, major_sections=200, minor_sections=100)
    mesh = Mesh(np.asarray(many.vertices), np.asarray(many.faces))
    assert convex_decomposition.decomposed(mesh, SETTINGS) == []
    said = "coacd cannot cut a mesh of 40000 faces into convex pieces: signal 24 ended it"
    assert caplog.messages[0].startswith(said)  # SIGXCPU
    monkeypatch.setattr(convex_decomposition.sys, "executable", "/bin/false")
    assert convex_decomposition.decomposed(tray(), SETTINGS) == []
    assert caplog.messages[1].endswith("into convex pieces: it ended with exit code 1")
