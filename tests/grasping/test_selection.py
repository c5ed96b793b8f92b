"""Ranking and the checks a candidate must pass."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import LimitsConfig, SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.collision import lowest_height, turned
from pipelines.grasping.feasibility.limits import Limits
from pipelines.grasping.grasp_candidates import Candidates, no_candidates
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.ranking.ranking import Ranking, by_eq8, rank_score
from pipelines.grasping.ranking.suppression import are_near
from pipelines.grasping.selection import select, surroundings
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render

CONFIG = SelectionConfig(opening_margins=())  # which has tests of its own
GRIPPER = load_gripper("rg2")
TURNS = np.radians(np.arange(0, 360, 30))
metres = st.floats(0.0, 0.2)


def seen(shapes):
    pose = looking_at_table()
    depth, index = render(shapes, pose)
    scene = SceneCloud(depth, CAMERA, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))
    return pose, scene, RegionCloud.from_mask(index == 0, scene)


SEEN = seen([Box((0.06, 0.06, 0.12))])


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


def chosen(candidates, turns, region, scene, config=CONFIG, ranking=None):
    around = surroundings(region, scene, GRIPPER, config)
    ranking = ranking or by_eq8(config)
    return select(candidates, turns, region, scene, GRIPPER, config, around, ranking)


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
    found = chosen(across_box(pose, [0.1, 0.09, 0.08]), TURNS, region, scene)
    assert len(found) > 0
    assert (np.diff(found.rank_score) <= 1e-6).all()
    expected = rank_score(found.clearance, found.enclosed_height, CONFIG)
    np.testing.assert_allclose(found.rank_score, expected)


def test_no_finger_goes_below_the_table():
    pose, scene, region = seen([Box((0.06, 0.06, 0.12))])
    heights = [0.003, 0.006, 0.02, 0.1]
    found = chosen(across_box(pose, heights), TURNS, region, scene)
    lowest = lowest_height(found.grasps, GRIPPER, scene.plane)
    assert (lowest >= CONFIG.min_table_distance).all()
    low = chosen(across_box(pose, [0.003]), TURNS, region, scene)
    assert len(low) == 0


def test_a_neighbour_in_the_way_of_a_finger_forbids_the_grasp():
    alone = seen([Box((0.06, 0.06, 0.12))])
    beside = seen([Box((0.06, 0.06, 0.12)), Box((0.05, 0.06, 0.12), (0.06, 0, 0))])
    straight = np.zeros(1)
    for (pose, scene, region), expected in ((alone, 1), (beside, 0)):
        found = chosen(across_box(pose, [0.1]), straight, region, scene)
        assert len(found) == expected


def test_a_neighbour_nearby_lowers_the_clearance():
    straight, clearances = np.zeros(1), []
    for gap in (0.02, 0.035):
        neighbour = Box((0.05, 0.06, 0.12), (0.03 + gap + 0.025, 0, 0))
        pose, scene, region = seen([Box((0.06, 0.06, 0.12)), neighbour])
        found = chosen(across_box(pose, [0.1]), straight, region, scene)
        clearances.append(float(found.clearance[0]))
    assert clearances[0] < clearances[1]
    # A finger reaches from the box's face by its clearance and thickness.
    outer = GRIPPER.clearance + GRIPPER.finger_thickness
    np.testing.assert_allclose(clearances, [0.02 - outer, 0.035 - outer], atol=0.004)


def test_fingers_inside_the_object_itself_are_a_collision():
    pose, scene, region = seen([Box((0.1, 0.06, 0.12))])
    # Contacts in the middle of the top face: the fingers would have to go through it.
    found = chosen(across_box(pose, [0.1]), np.zeros(1), region, scene)
    assert len(found) == 0


@pytest.mark.parametrize("width", [0.0005, 0.2])
def test_contacts_too_close_or_too_far_apart_are_left_out(width):
    pose, scene, region = seen([Box((0.06, 0.06, 0.12))])
    candidates = across_box(pose, [0.1], size=width)
    assert len(chosen(candidates, TURNS, region, scene)) == 0


def test_no_candidates_give_no_grasps():
    _, scene, region = seen([Box((0.06, 0.06, 0.12))])
    found = chosen(no_candidates("network"), TURNS, region, scene)
    assert len(found) == 0


def naive_choice(candidates, turns, region, scene):
    """What is free at the final pose, pair by pair and turn by turn, all points looked at."""
    around = surroundings(region, scene, GRIPPER, CONFIG)
    base = Grasps.from_contacts(candidates.contacts, candidates.approach)
    centre = np.median(region.points, axis=0)
    radius = np.percentile(np.linalg.norm(region.points - centre, axis=1), 90)
    off = np.linalg.norm(base.translation - centre, axis=1) / radius
    stability = candidates.quality * (1.0 - 0.5 * np.minimum(off, 1.0))
    found = []
    for pair in np.argsort(-stability, kind="stable"):
        for turn in turns:
            hand = turned(base, np.array([pair]), np.array([turn]))
            low, high = GRIPPER.boxes(hand.width[0]).transpose(1, 0, 2)
            if not (CONFIG.min_width <= hand.width[0] <= GRIPPER.max_width):
                continue
            steep = -hand.approach[0] @ scene.plane.normal
            ahead = hand.approach[0] @ (hand.translation[0] / np.linalg.norm(hand.translation[0]))
            if steep <= np.cos(CONFIG.max_approach_angle) or ahead <= np.cos(
                CONFIG.max_hidden_angle
            ):
                continue
            if lowest_height(hand, GRIPPER, scene.plane)[0] < CONFIG.min_table_distance:
                continue
            local = (around.points - hand.translation[0]) @ hand.rotation[0]
            inside = 0
            for lo, hi in zip(low - CONFIG.body_margin, high + CONFIG.body_margin, strict=True):
                inside += around.count[((local > lo) & (local < hi)).all(axis=1)].sum()
            between = (np.abs(local[:, 1]) < low[1, 1]) & (np.abs(local[:, 2]) < high[1, 2])
            between &= (local[:, 0] < high[1, 0]) & (local[:, 0] > low[1, 0])
            height = (high[1, 0] - local[between, 0]).max(initial=0.0)
            if inside <= CONFIG.max_points_inside and height >= CONFIG.min_enclosed:
                found.append((stability[pair], hand.translation[0], hand.approach[0]))
    best = max((entry[0] for entry in found), default=0.0)
    return [entry for entry in found if entry[0] >= CONFIG.min_stability * best][:96]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("highest", [0.11, 0.03])
def test_the_choice_is_that_of_trying_every_hand_on_every_point(seed, highest):
    rng = np.random.default_rng(seed)
    plate = Box((0.3, 0.1, 0.012), (0, -0.05, 0))  # lower than hands may come, as the table is not
    neighbour = Box((0.05, 0.05, 0.06), (0.08, 0.02, 0))
    pose, scene, region = seen([Box((0.06, 0.08, 0.1)), neighbour, plate])
    heights = rng.uniform(0.005, highest, 40)
    candidates = replace(
        across_box(pose, heights, rng.normal(0, 0.003), rng.uniform(0.05, 0.09)),
        quality=rng.uniform(0.8, 1.0, 40),
    )
    expected = naive_choice(candidates, TURNS, region, scene)
    final_pose_alone = replace(CONFIG, approach_distance=0.0, nms_distance=0.0)
    found = chosen(candidates, TURNS, region, scene, final_pose_alone).grasps
    assert len(expected) == len(found)
    assert len(found) > 0 or highest < 0.1  # the plate is in the way of all low hands
    for _, translation, approach in expected:
        away = np.abs(found.translation - translation).max(1) + np.abs(
            found.approach - approach
        ).max(1)
        assert away.min() < 1e-9


@given(st.integers(0, 2**31))
@settings(max_examples=15, deadline=None)
def test_what_is_chosen_opens_wide_enough_and_comes_and_stays_over_the_table(seed):
    rng = np.random.default_rng(seed)
    pose, scene, region = SEEN
    candidates = across_box(pose, rng.uniform(0.0, 0.11, 12), size=rng.uniform(0.02, 0.13))
    found = chosen(candidates, TURNS, region, scene).grasps
    assert (GRIPPER.opening(found.width) <= GRIPPER.max_opening + 1e-12).all()
    for step in np.linspace(0.0, CONFIG.approach_distance, 6):
        on_the_way = replace(found, translation=found.translation - step * found.approach)
        lowest = lowest_height(on_the_way, GRIPPER, scene.plane)
        assert (lowest >= CONFIG.min_table_distance - 1e-9).all()


def test_a_hand_that_would_come_through_something_is_not_chosen():
    straight, free_there = np.zeros(1), replace(CONFIG, approach_distance=0.0)
    # Behind the hand at its final pose, and no farther than it comes from.
    bar = Box((0.16, 0.03, 0.02), (0.0, 0.0, 0.25))
    pose, scene, region = seen([Box((0.06, 0.06, 0.12)), bar])
    candidates = across_box(pose, [0.1])
    assert len(chosen(candidates, straight, region, scene, free_there)) == 1
    assert len(chosen(candidates, straight, region, scene)) == 0
    aside = chosen(candidates, TURNS, region, scene)
    assert len(aside) > 0
    assert (-aside.grasps.approach @ pose[:3, 2] < 0.99).all()


def test_the_grasps_of_a_region_differ_and_are_ranked():
    pose, scene, region = SEEN
    found = chosen(across_box(pose, np.linspace(0.05, 0.11, 25)), TURNS, region, scene)
    near = are_near(found.grasps, CONFIG.nms_distance, CONFIG.nms_angle)
    assert len(found) > 1
    assert near.sum() == len(found)
    assert (np.diff(found.rank_score) <= 1e-6).all()
    everything = replace(CONFIG, nms_distance=0.0)
    alike = chosen(across_box(pose, np.linspace(0.05, 0.11, 25)), TURNS, region, scene, everything)
    assert len(alike) > len(found)
    np.testing.assert_array_equal(alike.grasps.rotation[0], found.grasps.rotation[0])


def test_limits_hold_for_what_is_chosen():
    pose, scene, region = SEEN
    cone = LimitsConfig(approach_cone=20.0)
    limited = replace(scene, limits=Limits.of(cone, None, scene.plane, CAMERA))
    candidates = across_box(pose, np.linspace(0.05, 0.11, 9))
    free, kept = (chosen(candidates, TURNS, region, each).grasps for each in (scene, limited))
    steep = np.cos(np.radians(20.0))
    assert (-free.approach @ pose[:3, 2] < steep).any()
    assert len(kept) > 0
    assert (-kept.approach @ pose[:3, 2] >= steep - 1e-9).all()


def test_what_ranks_decides_on_order_and_on_who_is_asked():
    pose, scene, region = seen([Box((0.06, 0.06, 0.12))])
    candidates, asked = across_box(pose, [0.1, 0.09, 0.08]), []

    def lowest_first(found, stability, visible):
        asked.append((len(found), stability.min() / stability.max(), visible.min(), visible.max()))
        return -scene.plane.height(found.grasps.translation)

    found = chosen(candidates, TURNS, region, scene, CONFIG, Ranking(lowest_first, 0.5, 40))
    heights = scene.plane.height(found.grasps.translation)
    np.testing.assert_allclose(found.rank_score, -heights)
    assert (np.diff(heights) >= -1e-6).all()
    (count, stability, *shares) = asked[0]
    assert 0 < count <= 40
    assert stability >= 0.5
    assert 0.0 <= shares[0] <= shares[1] <= 1.0
    chosen(candidates, TURNS, region, scene, CONFIG, Ranking(lowest_first, 0.95, 1))
    assert asked[-1][0] == 1
