"""Symmetric grasps open wider at the predicted contact, as far as there is free space."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.configs import FeasibilityConfig, RankingConfig
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.feasibility import Feasibility, with_opening_margin
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from tests.geometry.tabletops import Box, looking_at_table
from tests.grasping.seen_regions import seen

CONFIG, CAP = FeasibilityConfig(), RankingConfig.clearance_cap
GRIPPER = load_gripper("rg2")
BOX = Box((0.06, 0.06, 0.12))
POSE = looking_at_table()
FINGER = GRIPPER.clearance + GRIPPER.finger_thickness + CONFIG.body_margin


def checks_at_box(*others):
    _, scene, region = seen([BOX, *others], POSE)
    return Feasibility.at(region, scene, GRIPPER, CONFIG, CAP)


def grasp(width, slot=0):
    """From above, closing along the table's x; the first contact is the box's left side."""
    contacts = np.array([[-0.03, 0.0, 0.1], [-0.03 + width, 0.0, 0.1]])
    grasps = GraspPoses.from_contacts(transform_points(POSE, contacts)[None], -POSE[None, :3, 2])
    one = np.ones(1)
    return RankedGrasps(grasps, one, np.array([slot]), np.array(["network"]), one, one, one)


def widened(found, checks, **settings):
    return with_opening_margin(found, replace(checks, config=replace(CONFIG, **settings)), CAP)


@pytest.mark.parametrize("width", [0.05, 0.06])  # plane too near, or in its place
def test_the_second_contact_gets_a_margin_and_the_first_does_not_move(width):
    before = grasp(width)
    after = widened(before, checks_at_box())
    was, now = before.grasps.contacts[0], after.grasps.contacts[0]
    assert_allclose(now[0], was[0], atol=1e-12)
    along = before.grasps.closing[0]
    assert_allclose(now[1] - was[1], CONFIG.opening_margins[0] * along, atol=1e-12)
    assert after.clearance[0] <= CAP  # measured again: it was given as 1
    assert_allclose(after.grasps.rotation, before.grasps.rotation)


@pytest.mark.parametrize(("width", "margin"), [(0.034, 0.008), (0.028, 0.004), (0.01, 0.0)])
def test_close_contacts_get_a_smaller_margin(monkeypatch, width, margin):
    monkeypatch.setattr(Feasibility, "allows", lambda self, grasps: np.ones(len(grasps), bool))
    after = widened(grasp(width), checks_at_box())
    assert_allclose(after.grasps.width, width + margin, atol=1e-12)
    assert margin <= CONFIG.opening_margin_share * width


@pytest.mark.parametrize("gap", [0.0, 0.0035, 0.0055, 0.02])
def test_the_margin_is_the_largest_that_a_neighbour_leaves(gap):
    left = 0.03 + FINGER + gap  # next to the open finger
    checks = checks_at_box(Box((0.06, 0.06, 0.12), (left + 0.03, 0.0, 0.0)))
    found = widened(grasp(0.06), checks)
    margin = float(found.grasps.width[0] - 0.06)
    fitting = [0.0]
    for step in CONFIG.opening_margins:
        wider = widened(grasp(0.06), checks, opening_margins=(step,))
        fitting += [step] if wider.grasps.width[0] > 0.06 else []
    assert margin == pytest.approx(max(fitting))
    assert margin <= max(gap, 0.0) + 0.002
    assert checks.allows(found.grasps).all()


def test_contacts_of_a_planar_grasp_are_both_seen_and_get_no_margin():
    found = widened(grasp(0.06, slot=-1), checks_at_box())
    assert_allclose(found.grasps.width, 0.06)


def test_the_gripper_opens_no_wider_than_it_can():
    width = GRIPPER.max_width - 0.005
    found = widened(grasp(width), checks_at_box())
    assert found.grasps.width[0] == pytest.approx(width + 0.004)


def test_without_margins_nothing_changes():
    checks = checks_at_box()
    found = widened(grasp(0.06), checks, opening_margins=())
    assert_allclose(found.grasps.width, 0.06)
    assert len(widened(RankedGrasps.empty(), checks)) == 0
