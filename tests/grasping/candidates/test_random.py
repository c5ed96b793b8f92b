"""Random antipodal pairs, the baseline without any prediction."""

from dataclasses import replace

import numpy as np

from pipelines.configs import SelectionConfig
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.candidates.candidates import random_candidates
from pipelines.grasping.feasibility.feasibility import Feasibility
from tests.geometry.tabletops import Box
from tests.grasping.seen_regions import seen

CONFIG = SelectionConfig()


def test_random_pairs_lie_on_the_sides_that_face_the_fingers():
    _, scene, region = seen([Box((0.06, 0.06, 0.06))])
    checks = Feasibility.at(region, scene, load_gripper("rg2"), CONFIG.feasibility, 0.05)
    # Points on a side at y = -3 cm, on the side at y = 3 cm, and on the top between them.
    rng = np.random.default_rng(0)
    points, normals = rng.uniform(-0.025, 0.025, (90, 3)), np.repeat([[0, -1.0, 0]], 90, axis=0)
    points[:30, 1], points[30:60, 1], points[60:, 2] = -0.03, 0.03, 0.03
    normals[30:60], normals[60:] = [0, 1, 0], [0, 0, 1]
    shape = replace(region, points=points, normals=normals)
    pairs = random_candidates(shape, CONFIG.candidates, checks, rng)
    assert len(pairs) > 5
    np.testing.assert_array_equal(
        np.sort(pairs.contacts[..., 1], axis=1), [[-0.03, 0.03]] * len(pairs)
    )
