"""Seconds of annotate-symmetry on meshes of about 10,000 triangles, in total and by phase."""

import os
import statistics
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import trimesh

from benchmarks.timing import Measurement
from pipelines.annotation.objects import annotate
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.mesh_symmetry.detection.symmetry_detection import analyse
from pipelines.mesh_symmetry.parts.symmetric_parts import symmetric_regions
from pipelines.synthesis.objects.families import catalogue

FAMILIES = tuple(catalogue.FAMILIES)[::3]  # every third, a choice without a bias
NUM_FACES, MOST_FACES = 10000, 12000
CONFIG = AnnotateSymmetryConfig()
Each = TypeVar("Each")


def measure() -> list[Measurement]:
    """Return median CPU seconds per mesh: of the whole command, and of its phases."""
    meshes = [_mesh(family) for family in FAMILIES]
    found = [analyse(mesh, CONFIG, _rng()) for mesh in meshes]
    everything = _each(lambda mesh: annotate(mesh, "", CONFIG, _rng()), meshes)
    whole = _each(lambda mesh: analyse(mesh, CONFIG, _rng()), meshes)
    regions = _each(
        lambda pair: symmetric_regions(*pair, CONFIG, _rng()), list(zip(meshes, found, strict=True))
    )
    median, faces = statistics.median, int(statistics.median(len(mesh.faces) for mesh in meshes))
    note = (
        f"CPU, median of {len(meshes)} families, {faces:,} triangles: search {median(whole):.2f}, "
        f"regions {median(regions):.2f}, the rest doubt; mean {statistics.mean(everything):.2f}, "
        f"at most {max(everything):.2f} (coacd, where nothing is symmetric)"
    )
    return [
        Measurement("annotate-symmetry, a mesh of 10k triangles", median(everything), "s", note)
    ]


def _each(step: Callable[[Each], object], items: list[Each]) -> list[float]:
    taken = []
    for item in items:
        started = _cpu_seconds()
        step(item)
        taken.append(_cpu_seconds() - started)
    return taken


def _cpu_seconds() -> float:
    return sum(os.times()[:4])  # with children: coacd runs in a separate process


def _mesh(family: str) -> Mesh:
    mesh = catalogue.make_shape(family, _rng()).solid.mesh()
    edge = float(np.sqrt(4.0 * mesh.area / NUM_FACES))
    while True:
        vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, edge, 20)
        if len(faces) <= MOST_FACES or len(faces) == len(mesh.faces):
            return Mesh(vertices, faces)
        edge *= 1.2


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)
