"""Seconds of annotate-symmetry on meshes of about 10,000 triangles, and what they go into."""

import statistics
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import trimesh

from benchmarks.timing import Measurement
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.mesh import Mesh
from pipelines.geometry.symmetric_parts import symmetric_regions
from pipelines.geometry.symmetry_candidates import DistanceGrid
from pipelines.geometry.symmetry_detection import analyse
from pipelines.geometry.symmetry_search import Shape, search_axes, search_planes
from pipelines.synthesis.catalogue import make_shape

FAMILIES = ("can", "carton", "mug", "hammer", "sculpture")
NUM_FACES, MOST_FACES = 10000, 12000
Item = TypeVar("Item")
CONFIG = AnnotateSymmetryConfig()


def measure() -> list[Measurement]:
    """Return median CPU seconds a mesh: of all, and of the phases."""
    meshes = [_mesh(family) for family in FAMILIES]
    shapes = [Shape.from_mesh(mesh, CONFIG, _rng()) for mesh in meshes]
    grids = [
        DistanceGrid.around(shape.surface.points, CONFIG.grid_resolution, CONFIG.distance_cap)
        for shape in shapes
    ]
    pairs = list(zip(shapes, grids, strict=True))
    phases = {
        "sampling": _median(lambda mesh: Shape.from_mesh(mesh, CONFIG, _rng()), meshes),
        "planes": _median(lambda pair: search_planes(*pair, CONFIG), pairs),
        "axes": _median(lambda shape: search_axes(shape, CONFIG), shapes),
        "whole objects": _median(lambda mesh: analyse(mesh, CONFIG, _rng()), meshes),
    }
    total = _median(
        lambda mesh: symmetric_regions(mesh, analyse(mesh, CONFIG, _rng()), CONFIG, _rng()), meshes
    )
    split = ", ".join(f"{name} {seconds:.2f}" for name, seconds in phases.items())
    faces = int(statistics.median(len(mesh.faces) for mesh in meshes))
    note = f"CPU, median of {len(meshes)} meshes, {faces:,} triangles; {split}"
    return [Measurement("annotate-symmetry, a mesh of 10k triangles", total, "s", note)]


def _median(step: Callable[[Item], object], items: list[Item]) -> float:
    taken = []
    for item in items:
        started = time.process_time()
        step(item)
        taken.append(time.process_time() - started)
    return statistics.median(taken)


def _mesh(family: str) -> Mesh:
    mesh = make_shape(family, _rng()).solid.mesh()
    edge = float(np.sqrt(4.0 * mesh.area / NUM_FACES))
    while True:
        vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, edge, 20)
        if len(faces) <= MOST_FACES or len(faces) == len(mesh.faces):
            return Mesh(vertices, faces)
        edge *= 1.2


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)
