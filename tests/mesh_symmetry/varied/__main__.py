"""Symmetries found on constructed objects: `python -m tests.mesh_symmetry.varied SEED...`.

Each seed draws 17 bodies of revolution and 13 other objects; each is annotated unchanged, with
noise and with a hole. The command prints every fault, and a table for all seeds.
"""

import sys
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.mesh_symmetry.detection.symmetry_detection import detect_symmetries
from tests.mesh_symmetry.varied import defects, shapes
from tests.mesh_symmetry.varied.judge import judged
from tests.mesh_symmetry.varied.shapes import Varied

Spoil = Callable[[Varied, np.random.Generator], Mesh]
VARIANTS: dict[str, Spoil] = {
    "clean": lambda truth, _: truth.mesh,
    "noise": lambda truth, rng: defects.noisy(truth.mesh, rng),
    "hole": lambda truth, rng: defects.holed(truth.mesh, rng, truth.feature, truth.images),
}


def main() -> None:
    """Annotate the objects of all seeds, and print the table."""
    sys.stdout.write("| variant | axes found | axes false | planes found | planes false |\n")
    sys.stdout.write("|---|---|---|---|---|\n")
    for variant in VARIANTS:
        total = Counter[str]()
        for seed in map(int, sys.argv[1:]):
            total += counted(variant, seed)
        axes = f"{total['axis']} of {total['axis'] + total['missed axis']}"
        planes = f"{total['plane']} of {total['plane'] + total['missed plane']}"
        false = total["false axis"] + total["false sphere"]
        sys.stdout.write(f"| {variant} | {axes} | {false} | {planes} | {total['false plane']} |\n")
        sys.stdout.flush()


def counted(variant: str, seed: int) -> Counter[str]:
    """Return the counts of true, false and missed symmetries of all objects of `seed`."""
    total = Counter[str]()
    for name, truth in objects(seed):
        rng = np.random.default_rng(zlib.crc32(f"{name} {variant} {seed}".encode()))
        mesh = VARIANTS[variant](truth, rng)
        found = detect_symmetries(mesh, AnnotateSymmetryConfig(), np.random.default_rng(0))
        tally = judged(replace(truth, mesh=mesh), found)
        total += tally
        if faults := [fault for fault in tally if tally[fault] and " " in fault]:
            sys.stderr.write(f"{variant} {seed} {name}: {', '.join(faults)}\n")
    return total


def objects(seed: int) -> Iterator[tuple[str, Varied]]:
    """Yield the name of each object of `seed`, and the object."""
    for draw in shapes.BODIES:
        yield draw.__name__, shapes.body(draw, generator(draw, seed))
    for other in shapes.OTHERS:
        yield other.__name__, other(generator(other, seed))


def generator(draw: Callable[..., object], seed: int) -> np.random.Generator:
    """Return the random generator of the object of `draw`."""
    return np.random.default_rng(zlib.crc32(f"{draw.__name__} {seed}".encode()))


if __name__ == "__main__":
    main()
