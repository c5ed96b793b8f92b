"""The ranking by Eq. 8."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RankingConfig
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.ranking import ByEq8, eq8_score

CONFIG = RankingConfig()
metres = st.floats(0.0, 0.2)


@given(metres, metres)
@settings(max_examples=25, deadline=None)
def test_the_score_is_equation_8(b, h):
    expected = np.tanh(1.0 * min(b / 0.05, 1.0)) * np.tanh(5.0 * min(h / 0.03, 1.0))
    np.testing.assert_allclose(eq8_score(b, h, CONFIG), expected, rtol=1e-12)


@given(metres, metres, metres)
@settings(max_examples=25, deadline=None)
def test_more_clearance_and_more_height_never_rank_lower(b, h, more):
    here = eq8_score(b, h, CONFIG)
    assert eq8_score(b + more, h, CONFIG) >= here
    assert eq8_score(b, h + more, CONFIG) >= here


def test_unseen_space_at_the_finger_tips_lowers_the_score():
    grasps = GraspPoses(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.full(2, 0.05))
    b, h = np.array([0.02, 0.05]), np.array([0.01, 0.03])
    found = RankedGrasps(grasps, b, np.zeros(2, int), np.array(["planar"] * 2), b, h, b)
    seen, unseen = (ByEq8(CONFIG).score(found, b, np.full(2, share)) for share in (1.0, 0.0))
    np.testing.assert_allclose(seen, eq8_score(b, h, CONFIG))
    np.testing.assert_allclose(unseen, (1.0 - CONFIG.weight_unseen) * seen)
