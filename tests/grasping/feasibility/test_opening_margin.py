"""Symmetric grasps open wider on the side that is a guess, as far as that is free."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.opening_margin import is_feasible, with_opening_margin
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.selection import surroundings
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")
BOX = Box((0.06, 0.06, 0.12))
POSE = looking_at_table()
FINGER = GRIPPER.clearance + GRIPPER.finger_thickness + CONFIG.body_margin


def seen(*others):
    depth, index = render([BOX, *others], POSE)
    plane = Plane(POSE[:3, 2], float(-POSE[:3, 2] @ POSE[:3, 3]))
    scene = SceneCloud(depth, CAMERA, plane)
    region = RegionCloud.from_mask(index == 0, scene)
    return scene, surroundings(region, scene, GRIPPER, CONFIG)


def hand(width, slot=0):
    """From above, closing along the table's x; the first contact is the box's left side."""
    contacts = np.array([[-0.03, 0.0, 0.1], [-0.03 + width, 0.0, 0.1]])
    grasps = Grasps.from_contacts(transform_points(POSE, contacts)[None], -POSE[None, :3, 2])
    one = np.ones(1)
    return RankedGrasps(grasps, one, np.array([slot]), np.array(["network"]), one, one, one)


def widened(found, scene, around, config=CONFIG):
    return with_opening_margin(found, scene, GRIPPER, config, around)


@pytest.mark.parametrize("width", [0.05, 0.06])  # the plane too near, and where it is
def test_the_second_contact_gets_room_and_the_first_stays(width):
    before, (scene, around) = hand(width), seen()
    after = widened(before, scene, around)
    was, now = before.grasps.contacts[0], after.grasps.contacts[0]
    assert_allclose(now[0], was[0], atol=1e-12)
    along = before.grasps.closing[0]
    assert_allclose(now[1] - was[1], CONFIG.opening_margins[0] * along, atol=1e-12)
    assert after.clearance[0] <= CONFIG.clearance_cap  # measured anew: it was told as 1
    assert_allclose(after.grasps.rotation, before.grasps.rotation)


@pytest.mark.parametrize(("width", "room"), [(0.034, 0.008), (0.028, 0.006), (0.01, 0.002)])
def test_close_contacts_get_less_wherever_there_is_room(monkeypatch, width, room):
    monkeypatch.setattr(
        "pipelines.grasping.feasibility.opening_margin.is_feasible",
        lambda hands, *_: np.ones(len(hands), bool),
    )
    after = widened(hand(width), *seen())
    assert_allclose(after.grasps.width, width + room, atol=1e-12)
    assert room <= CONFIG.opening_margin_share * width


@pytest.mark.parametrize("gap", [0.0, 0.0035, 0.0055, 0.02])
def test_it_gets_the_most_room_that_a_neighbour_leaves(gap):
    left = 0.03 + FINGER + gap  # beside the open finger
    scene, around = seen(Box((0.06, 0.06, 0.12), (left + 0.03, 0.0, 0.0)))
    found = widened(hand(0.06), scene, around)
    room = float(found.grasps.width[0] - 0.06)
    fitting = [0.0]
    for step in CONFIG.opening_margins:
        wider = widened(hand(0.06), scene, around, replace(CONFIG, opening_margins=(step,)))
        fitting += [step] if wider.grasps.width[0] > 0.06 else []
    assert room == pytest.approx(max(fitting))
    assert room <= max(gap, 0.0) + 0.002
    assert is_feasible(found.grasps, scene, GRIPPER, CONFIG, around).all()


def test_both_contacts_of_a_planar_grasp_are_seen_and_stay():
    scene, around = seen()
    found = widened(hand(0.06, slot=-1), scene, around)
    assert_allclose(found.grasps.width, 0.06)


def test_the_hand_opens_no_wider_than_it_can():
    scene, around = seen()
    width = GRIPPER.max_width - 0.005
    assert widened(hand(width), scene, around).grasps.width[0] == pytest.approx(width + 0.004)


def test_without_room_to_spare_nothing_changes():
    scene, around = seen()
    found = widened(hand(0.06), scene, around, replace(CONFIG, opening_margins=()))
    assert_allclose(found.grasps.width, 0.06)
    assert len(widened(RankedGrasps.empty(), scene, around)) == 0
