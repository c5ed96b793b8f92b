"""Ranking and the checks a candidate must pass."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import SelectionConfig
from pipelines.formats.gripper_files import load_gripper
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.collision import lowest_height
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.selection import Candidates, no_candidates, rank_score, select
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")
TURNS = np.radians(np.arange(0, 360, 30))
metres = st.floats(0.0, 0.2)


def seen(shapes):
    pose = looking_at_table()
    depth, index = render(shapes, pose)
    scene = SceneCloud(depth, CAMERA, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))
    return pose, scene, RegionCloud.from_mask(index == 0, scene)


def across_box(pose, heights, x=0.0, size=0.06):
    """Candidates on the left and right faces of a box at `x`, straight from above."""
    pairs = [[[x - size / 2, 0, h], [x + size / 2, 0, h]] for h in heights]
    contacts = transform_points(pose, np.array(pairs))
    count = len(heights)
    return Candidates(
        contacts,
        np.tile(-pose[:3, 2], (count, 1)),
        np.ones(count),
        np.linspace(1.0, 0.5, count),
        np.zeros(count, np.int64),
        "network",
    )


@given(metres, metres)
@settings(max_examples=25, deadline=None)
def test_the_rank_is_equation_8(b, h):
    expected = np.tanh(1.0 * min(b / 0.05, 1.0)) * np.tanh(5.0 * min(h / 0.03, 1.0))
    np.testing.assert_allclose(rank_score(b, h, CONFIG), expected, rtol=1e-12)


@given(metres, metres, metres)
@settings(max_examples=25, deadline=None)
def test_more_clearance_and_more_height_never_rank_lower(b, h, more):
    here = rank_score(b, h, CONFIG)
    assert rank_score(b + more, h, CONFIG) >= here
    assert rank_score(b, h + more, CONFIG) >= here


def test_a_grasp_from_above_is_feasible_and_ranked_by_its_numbers():
    pose, scene, region = seen([Box((0.06, 0.06, 0.12))])
    found = select(across_box(pose, [0.1, 0.09, 0.08]), TURNS, region, scene, GRIPPER, CONFIG)
    assert len(found) > 0
    assert (np.diff(found.rank_score) <= 1e-6).all()
    expected = rank_score(found.clearance, found.enclosed_height, CONFIG)
    np.testing.assert_allclose(found.rank_score, expected)


def test_no_finger_goes_below_the_table():
    pose, scene, region = seen([Box((0.06, 0.06, 0.12))])
    heights = [0.003, 0.006, 0.02, 0.1]
    found = select(across_box(pose, heights), TURNS, region, scene, GRIPPER, CONFIG)
    lowest = lowest_height(found.grasps, GRIPPER, scene.plane)
    assert (lowest >= CONFIG.min_table_distance).all()
    low = select(across_box(pose, [0.003]), TURNS, region, scene, GRIPPER, CONFIG)
    assert len(low) == 0


def test_a_neighbour_in_the_way_of_a_finger_forbids_the_grasp():
    alone = seen([Box((0.06, 0.06, 0.12))])
    beside = seen([Box((0.06, 0.06, 0.12)), Box((0.05, 0.06, 0.12), (0.06, 0, 0))])
    straight = np.zeros(1)
    for (pose, scene, region), expected in ((alone, 1), (beside, 0)):
        found = select(across_box(pose, [0.1]), straight, region, scene, GRIPPER, CONFIG)
        assert len(found) == expected


def test_a_neighbour_nearby_lowers_the_clearance():
    straight, clearances = np.zeros(1), []
    for gap in (0.02, 0.035):
        neighbour = Box((0.05, 0.06, 0.12), (0.03 + gap + 0.025, 0, 0))
        pose, scene, region = seen([Box((0.06, 0.06, 0.12)), neighbour])
        found = select(across_box(pose, [0.1]), straight, region, scene, GRIPPER, CONFIG)
        clearances.append(float(found.clearance[0]))
    assert clearances[0] < clearances[1]
    # A finger reaches from the box's face by its clearance and thickness.
    outer = GRIPPER.clearance + GRIPPER.finger_thickness
    np.testing.assert_allclose(clearances, [0.02 - outer, 0.035 - outer], atol=0.004)


def test_fingers_inside_the_object_itself_are_a_collision():
    pose, scene, region = seen([Box((0.1, 0.06, 0.12))])
    # Contacts in the middle of the top face: the fingers would have to go through it.
    found = select(across_box(pose, [0.1]), np.zeros(1), region, scene, GRIPPER, CONFIG)
    assert len(found) == 0


@pytest.mark.parametrize("width", [0.0005, 0.2])
def test_contacts_too_close_or_too_far_apart_are_left_out(width):
    pose, scene, region = seen([Box((0.06, 0.06, 0.12))])
    candidates = across_box(pose, [0.1], size=width)
    assert len(select(candidates, TURNS, region, scene, GRIPPER, CONFIG)) == 0


def test_no_candidates_give_no_grasps():
    _, scene, region = seen([Box((0.06, 0.06, 0.12))])
    found = select(no_candidates("network"), TURNS, region, scene, GRIPPER, CONFIG)
    assert len(found) == 0
