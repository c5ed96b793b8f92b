"""Grasps open wider at a predicted contact and about seen points, as far as there is free space."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.configs import FeasibilityConfig, RankingConfig
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.collision import reach_between
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.feasibility.openings import with_fitted_openings
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.obstacles import Obstacles
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
    return with_fitted_openings(found, replace(checks, config=replace(CONFIG, **settings)), CAP)


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


def test_contacts_of_a_planar_grasp_about_the_object_stay():
    found = widened(grasp(0.062, slot=-1), checks_at_box())
    assert_allclose(found.grasps.width, 0.062)


def test_contacts_of_a_planar_grasp_are_moved_to_enclose_the_seen_points():
    before = grasp(0.055, slot=-1)  # the second contact is 5 mm inside the box
    after = widened(before, checks_at_box())
    was, now = before.grasps.contacts[0], after.grasps.contacts[0]
    assert_allclose(now[0], was[0], atol=1e-3)
    along = float((now[1] - was[1]) @ before.grasps.closing[0])
    assert 0.005 - CONFIG.scene_resolution - 1e-3 < along < 0.005  # points are thinned
    assert_allclose(after.grasps.rotation, before.grasps.rotation)
    assert after.clearance[0] <= CAP  # measured again: it was given as 1


def test_contacts_of_a_planar_grasp_stay_if_the_setting_is_off():
    found = widened(grasp(0.056, slot=-1), checks_at_box(), encloses_seen_points=False)
    assert_allclose(found.grasps.width, 0.056)


def test_contacts_of_a_planar_grasp_stay_where_a_neighbour_leaves_no_room():
    left = 0.03 + FINGER - 0.004  # there is room for the fingers as they are
    checks = checks_at_box(Box((0.06, 0.06, 0.12), (left + 0.03, 0.0, 0.0)))
    before = grasp(0.055, slot=-1)
    assert checks.allows(before.grasps).all()
    assert_allclose(widened(before, checks).grasps.width, 0.055)


@pytest.mark.parametrize("allowed", [0, 2, 5])
def test_the_reach_of_points_between_the_fingers(allowed):
    rng = np.random.default_rng(3)
    grasps = grasp(0.05).grasps
    local = rng.uniform(-0.07, 0.07, (400, 3))
    count = rng.integers(1, 4, len(local))
    obstacles = Obstacles(local @ grasps.rotation[0].T + grasps.translation[0], count)
    config = replace(CONFIG, max_points_inside=allowed)
    found = reach_between(grasps, GRIPPER, obstacles, config)[0]
    back, tip = GRIPPER.tip_reach - GRIPPER.finger_length, GRIPPER.tip_reach
    inside = (back < local[:, 0]) & (local[:, 0] < tip)
    inside &= np.abs(local[:, 1]) < GRIPPER.opening(0.05) / 2
    inside &= np.abs(local[:, 2]) < GRIPPER.finger_height / 2
    across = np.repeat(local[inside, 1], count[inside])
    for sign, reach in zip((-1, 1), found, strict=True):
        assert reach == pytest.approx(max(np.sort(sign * across)[-1 - allowed], 0.0), abs=1e-6)


def test_points_elsewhere_have_no_reach():
    far = Obstacles(np.array([[1.0, 1.0, 1.0]]), np.array([9]))
    assert_allclose(reach_between(grasp(0.05).grasps, GRIPPER, far, CONFIG), 0.0)
    none = Obstacles(np.zeros((0, 3)), np.zeros(0, np.int64))
    assert_allclose(reach_between(grasp(0.05).grasps, GRIPPER, none, CONFIG), 0.0)


def test_the_gripper_opens_no_wider_than_it_can():
    width = GRIPPER.max_width - 0.005
    found = widened(grasp(width), checks_at_box())
    assert found.grasps.width[0] == pytest.approx(width + 0.004)


def test_without_margins_nothing_changes():
    checks = checks_at_box()
    found = widened(grasp(0.06), checks, opening_margins=())
    assert_allclose(found.grasps.width, 0.06)
    assert len(widened(RankedGrasps.empty(), checks)) == 0
