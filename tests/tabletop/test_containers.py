"""Outside and inside of an open container are one region, other neighbours are not."""

import numpy as np
import pytest

from pipelines.configs import RegionConfig
from pipelines.tabletop.regions.containers import insides
from pipelines.tabletop.regions_geometric import geometric_regions
from tests.geometry.tabletops import CAMERA, Ball, Box, Cup, looking_at_table, render

OUTSIDE, INSIDE = Cup(0.045, 0.08), Cup(0.045, 0.08, inside=True)


def seen(*shapes, elevation=0.7):
    """Return labels 1, 2, ... for `shapes`, and the `ObjectCriteria` of their image."""
    depth, index = render(shapes, looking_at_table(elevation=elevation))
    regions = geometric_regions(depth, CAMERA, RegionConfig(), np.random.default_rng(0))
    return (index + 1).astype(np.int32), regions.criteria


@pytest.mark.parametrize("elevation", [0.6, 0.8, 1.0])
def test_the_surface_seen_over_the_rim_of_a_cup_is_its_inside(elevation):
    assert insides(*seen(OUTSIDE, INSIDE, elevation=elevation)) == {2: 1}
    assert insides(*seen(INSIDE, OUTSIDE, elevation=elevation)) == {1: 2}


def test_a_box_behind_a_box_of_its_height_is_not_its_inside():
    assert insides(*seen(Box((0.09, 0.05, 0.08), (0, -0.06, 0)), Box((0.09, 0.05, 0.08)))) == {}


def test_a_low_box_behind_an_upright_plate_is_not_its_inside():
    assert insides(*seen(Box((0.09, 0.006, 0.08), (0, -0.06, 0)), Box((0.09, 0.05, 0.06)))) == {}


def test_the_lid_of_a_box_is_not_the_inside_of_its_side():
    labels, criteria = seen(Box((0.09, 0.09, 0.08)))
    lid = criteria.tabletop.plane.height(criteria.xyz) > 0.078
    assert insides(labels * (1 + lid), criteria) == {}


def test_a_cup_is_not_the_inside_of_a_box_of_its_height_next_to_it():
    labels, criteria = seen(OUTSIDE, INSIDE, Box((0.05, 0.05, 0.08), (0.075, -0.04, 0)))
    whole = np.where(labels == 2, 1, labels).astype(np.int32)
    assert insides(whole, criteria) == {}


def test_a_ball_in_a_cup_stays_a_region_of_its_own():
    labels, criteria = seen(OUTSIDE, INSIDE, Ball(0.03, (0.0, 0.01, 0.032)))
    assert insides(labels, criteria) == {2: 1}


def test_without_a_table_no_region_is_an_inside():
    depth, index = render([OUTSIDE, INSIDE], looking_at_table(elevation=0.7))
    cut = np.where(index >= 0, depth, 0.0)
    regions = geometric_regions(cut, CAMERA, RegionConfig(), np.random.default_rng(0))
    assert regions.plane is None
    assert insides((index + 1).astype(np.int32), regions.criteria) == {}
