"""Detection of the symmetries that families of later object sets have by construction."""

import numpy as np
import pytest

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.mesh_symmetry.detection.symmetry_detection import analyse
from pipelines.synthesis.objects.families.catalogue import SEALED, WIDER_FAMILIES, make_shape

QUICK = AnnotateSymmetryConfig(
    num_samples=8000, num_verification_samples=1000, plane_directions=400, axis_directions=250
)
MOST_PLANES, IMPLIED = 3, 2  # an object's planes in a label; the order of two planes' axis


def kinds(symmetries):
    planes = sum(symmetry.kind == "reflection" for symmetry in symmetries)
    axes = [each.order for each in symmetries if each.kind == "rotation" and each.order != IMPLIED]
    return min(planes, MOST_PLANES), axes


@pytest.mark.parametrize("family", [*WIDER_FAMILIES, *SEALED])
def test_the_symmetries_by_construction_are_found(family):
    shape = make_shape(family, np.random.default_rng([11, 0]))
    found = analyse(shape.solid.mesh(), QUICK, np.random.default_rng(0)).symmetries
    assert kinds(found) == kinds(shape.symmetries)
