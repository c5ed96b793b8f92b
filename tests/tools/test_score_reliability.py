"""The interval of the difference between score and success rate."""

import numpy as np
from numpy.testing import assert_allclose

from tools.score_reliability import TriedGrasp, excess, reliability_rows


def test_the_interval_is_over_scenes_and_not_over_similar_grasps():
    rng = np.random.default_rng(0)
    alike = [TriedGrasp(scene, 0.8, held) for scene, held in enumerate(rng.random(10) < 0.5)]
    more, low, high = excess(alike)
    assert_allclose(more, 0.8 - np.mean([each.held for each in alike]))
    assert low < more < high
    assert_allclose(excess(alike * 20), (more, low, high))


def test_a_row_has_the_success_of_its_bin():
    tried = [TriedGrasp(0, 0.95, True), TriedGrasp(0, 0.97, False), TriedGrasp(1, 0.1, False)]
    rows = reliability_rows(tried)[2:]
    assert [row.split(" | ")[:4] for row in rows] == [
        ["| 0.1-0.2", "1", "0.10", "0.00"],
        ["| 0.9-1.0", "2", "0.96", "0.50"],
    ]
