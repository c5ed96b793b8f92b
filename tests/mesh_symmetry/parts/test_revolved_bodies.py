"""Bodies of revolution among the parts of a surface."""

import numpy as np
import pytest

from pipelines.mesh_symmetry.parts.revolved_bodies import revolved_bodies
from pipelines.mesh_symmetry.parts.sampled_parts import SampledParts
from tests.geometry.symmetric_shapes import crossed_columns

Y, Z = np.eye(3)[1], np.eye(3)[2]


def bodies_of(mesh, seed):
    parts = SampledParts.of(mesh, 8000, np.random.default_rng(seed))
    return revolved_bodies(parts, np.ones(8000, dtype=bool), 0.1)


@pytest.mark.parametrize("seed", range(8))
def test_separate_columns_are_bodies_for_any_samples(seed):
    assert len(bodies_of(crossed_columns(), seed)) == 2


def test_a_separate_body_includes_all_its_triangles():
    for seed in range(4):
        members = np.sum([body.members for body in bodies_of(crossed_columns(), seed)], axis=0)
        assert members.min() == members.max() == 1
