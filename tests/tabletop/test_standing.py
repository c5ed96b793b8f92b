"""Objects that hang into the image from outside do not stand, nor does their foot."""

import numpy as np

from pipelines.configs import RegionConfig
from pipelines.tabletop.regions_geometric import geometric_regions
from tests.geometry.tabletops import CAMERA, Box, Can, looking_at_table, render

BOX = Box((0.08, 0.08, 0.1), (-0.2, 0.0, 0.0))
FOOT = Can(0.05, 0.22, (0.1, 0.1, 0.0))
ARM = Box((0.3, 0.08, 0.3), (0.2, 0.1, 0.235))  # most of it is to the side of its foot
FLOOR = Box((8.0, 8.0, 0.1), (0.0, 0.0, -0.8))
VIEW = looking_at_table(elevation=0.6)


def things_among(*shapes):
    """Return for each of `shapes` whether it may be an object; their outlines lack depth."""
    depth, index = render((*shapes, FLOOR), VIEW)
    for shape in range(len(shapes)):
        own = index == shape
        shadow = np.roll(own, 6, axis=0) | np.roll(own, 3, axis=0)
        depth[shadow & ((index == -1) | (index == len(shapes)))] = 0.0
    regions = geometric_regions(depth, CAMERA, RegionConfig(), np.random.default_rng(0))
    return [regions.may_be_object(index == shape) for shape in range(len(shapes))]


def test_an_arm_from_above_is_no_object_even_without_depth_beneath_it():
    assert things_among(BOX, Box((0.06, 0.06, 0.3), (0.1, 0.0, 0.25))) == [True, False]


def test_the_large_foot_under_a_hanging_arm_is_no_object():
    assert things_among(BOX, FOOT, ARM) == [True, False, False]
    assert things_among(BOX, FOOT) == [True, True]


def test_a_small_object_beneath_a_hanging_arm_stays_an_object():
    low = Can(0.04, 0.08, (0.1, 0.1, 0.0))
    assert things_among(low, Box((0.08, 0.08, 0.4), (0.1, 0.1, 0.1))) == [True, False]


def test_a_mushroom_stands_although_the_camera_sees_beneath_its_cap():
    stem, cap = Can(0.012, 0.12), Can(0.05, 0.02, (0.0, 0.0, 0.12))
    assert things_among(BOX, stem, cap)[2]


def test_a_finger_is_no_object_although_a_step_in_depth_separates_it_from_its_hand():
    hand = Box((0.1, 0.1, 0.3), (0.1, 0.0, 0.25))
    finger = Box((0.03, 0.03, 0.12), (0.1, -0.12, 0.16))
    assert things_among(BOX, hand, finger) == [True, False, False]


def test_a_cap_far_from_a_hand_stays_an_object():
    stem, cap = Can(0.012, 0.12), Can(0.05, 0.02, (0.0, 0.0, 0.12))
    hand = Box((0.08, 0.08, 0.3), (0.22, 0.0, 0.25))
    assert things_among(cap, hand, stem)[:2] == [True, False]
