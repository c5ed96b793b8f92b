"""The ranking by Eq. 8, and by a critic with the torque of the weight."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RankingConfig
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.grasping.ranking.ranking import (
    critic_score,
    eq8_score,
    torque_arm,
    visible_eq8_score,
)
from tests.grasping.ranking.test_grasp_features import KNOWN, hands

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
    seen, unseen = (visible_eq8_score(found, np.full(2, share), CONFIG) for share in (1.0, 0.0))
    np.testing.assert_allclose(seen, eq8_score(b, h, CONFIG))
    np.testing.assert_allclose(unseen, (1.0 - CONFIG.weight_unseen) * seen)


UP = np.array([0.0, 0.0, 1.0])
DOWN_ACROSS_Y = GraspPoses.from_contacts([[[0.0, -0.02, 0.0], [0.0, 0.02, 0.0]]], [-UP])


@pytest.mark.parametrize(
    ("center", "arm"),
    [
        ((0.03, 0.0, 0.0), 0.03),
        ((0.03, 0.2, -0.05), 0.03),  # offsets along the closing line and straight down cost nothing
        ((0.0, 0.2, 0.0), 0.0),
        ((0.0, 0.0, -0.1), 0.0),
    ],
)
def test_the_arm_is_the_horizontal_distance_of_the_weight_from_the_closing_line(center, arm):
    np.testing.assert_allclose(torque_arm(DOWN_ACROSS_Y, np.array(center), UP), [arm], atol=1e-12)


def test_a_weight_at_half_torque_arm_halves_the_expected_quality():
    def even(features):
        return np.full(len(features.feasible), 0.8)

    found = hands()
    aside = found.grasps.translation + 0.02 * found.grasps.binormal
    grasps = GraspPoses(found.grasps.rotation, aside, found.grasps.width)
    found = replace(found, grasps=grasps)
    arm = torque_arm(found.grasps, KNOWN.center, KNOWN.scene.up)[0]
    features = GraspFeatures(found, np.ones(1), np.ones(1), KNOWN)
    for share, half in ((0.5, arm), (0.8, 2.0 * arm)):
        score = critic_score(features, even, replace(CONFIG, half_torque_arm=half))
        np.testing.assert_allclose(score, [0.8 * share])


def test_the_expected_weight_is_on_the_symmetries_by_their_confidence():
    middle, plane = KNOWN.region.middle, KNOWN.symmetries.symmetry(0)

    def off_plane(confidence):
        symmetries = replace(
            KNOWN.symmetries, probability=confidence * KNOWN.symmetries.probability
        )
        return (replace(KNOWN, symmetries=symmetries).center - plane.point) @ plane.normal

    assert abs(off_plane(0.0)) > 0.01
    np.testing.assert_allclose(off_plane(0.0), (middle - plane.point) @ plane.normal)
    np.testing.assert_allclose(
        [off_plane(0.5), off_plane(1.0)], [0.5 * off_plane(0.0), 0.0], atol=1e-12
    )
