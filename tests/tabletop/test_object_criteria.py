"""Walls, arms and pieces outside of the support are no objects."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.tabletop.regions_geometric import geometric_regions
from tests.geometry.tabletops import CAMERA, Box, render

BOX = Box((0.08, 0.08, 0.1))
WALL = Box((0.3, 0.02, 0.2), (0.0, 0.36, 0.0))


def found(*shapes):
    depth, index = render(shapes)
    return geometric_regions(depth, CAMERA, RegionConfig(), np.random.default_rng(0)), index


def is_region(regions, true):
    return any((mask & true).sum() > 0.5 * true.sum() for mask in regions.masks)


def test_a_wall_behind_the_table_is_no_region_and_the_box_in_front_of_it_is():
    regions, index = found(BOX, WALL)
    assert is_region(regions, index == 0)
    assert not is_region(regions, index == 1)
    assert not regions.may_be_object(index == 1)
    assert regions.may_be_object(index == 0)


def test_a_wall_of_the_same_size_in_the_middle_of_the_table_is_an_object():
    regions, index = found(Box((0.3, 0.02, 0.2)))
    assert regions.may_be_object(index == 0)


def test_a_piece_that_is_too_long_is_no_object():
    regions, index = found(Box((0.7, 0.05, 0.05)))
    assert not regions.may_be_object(index == 0)


def test_a_tall_piece_that_reaches_in_from_outside_is_no_object_and_a_book_there_is():
    arm, index = found(Box((0.5, 0.06, 0.12), (-0.45, 0.0, 0.0)))
    assert not arm.may_be_object(index == 0)
    book, index = found(Box((0.3, 0.2, 0.02), (-0.4, 0.0, 0.0)))
    assert book.may_be_object(index == 0)


def test_a_piece_that_mostly_hangs_over_the_table_is_no_object():
    regions, index = found(BOX)
    rows = np.nonzero(index == 0)[0]
    for share, expected in ((0.4, True), (0.6, False)):
        upper = np.arange(len(index))[:, None] < np.quantile(rows, share)
        criteria = replace(regions.criteria, hanging=(index == 0) & upper)
        assert criteria.may_be_object(index == 0) == expected


def test_a_rim_outside_of_the_support_is_no_object():
    regions, index = found(BOX, Box((0.3, 0.08, 0.04), (0.0, 0.4, 0.0)))
    assert not regions.may_be_object(index == 1)


def bin_from_above(floor_edge, slope=0.6):
    """Return the depth of a bin whose right side appears larger than its floor."""
    v, u = np.indices((240, 320), dtype=float)
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1
    )
    depth = np.full(u.shape, 0.6)
    for side, edge in (((1, 0), floor_edge), ((-1, 0), 0.3), ((0, 1), 0.12), ((0, -1), 0.12)):
        inward = np.array([*(-np.sin(slope) * np.array(side)), -np.cos(slope)])
        foot = np.array([side[0] * edge, side[1] * edge, 0.6])
        depth = np.minimum(depth, (inward @ foot) / (rays @ inward))
    return depth


def test_the_floor_of_a_bin_is_its_support_even_if_a_side_appears_larger():
    depth = bin_from_above(floor_edge=0.03)
    plane = geometric_regions(depth, CAMERA, RegionConfig(), np.random.default_rng(0)).plane
    assert -plane.normal[2] > 0.99


def test_a_piece_without_depth_may_be_an_object():
    regions, index = found(BOX)
    assert regions.may_be_object(np.zeros(index.shape, bool))


def test_points_stretched_along_the_view_are_a_smear_and_a_steep_box_is_not():
    regions, index = found(BOX)
    criteria = regions.criteria
    box = criteria.xyz[index == 0]
    assert not criteria.is_smear(box)
    middle = np.median(box, axis=0)
    ray = middle / np.linalg.norm(middle)
    stretched = box + 6.0 * np.outer((box - middle) @ ray, ray)
    assert criteria.is_smear(stretched)


@pytest.mark.parametrize(("length", "is_smear"), [(0.045, False), (0.053, True)])
def test_a_smear_is_over_twice_as_long_along_the_view_as_wide(length, is_smear):
    # 2 cm wide; nine tenths of the length are compared with 2.2 widths: 49 mm decide.
    across, along = np.linspace(-0.01, 0.01, 60), np.linspace(-0.5, 0.5, 61) * length
    x, z = (each.ravel() for each in np.meshgrid(across, 0.7 + along))
    points = np.stack([x, np.zeros_like(x), z], axis=1)
    assert found(BOX)[0].criteria.is_smear(points) is is_smear


def test_a_sliver_that_leads_from_a_table_toward_the_camera_is_no_region():
    camera = Intrinsics(524.0, 524.0, 319.5, 239.5, 640, 480)
    depth, _ = render([], camera=camera)
    near = depth[240, 320] - np.linspace(0.01, 0.13, 20)
    depth[233:247, 320:340] = near
    regions = geometric_regions(depth, camera, RegionConfig(), np.random.default_rng(0))
    assert not regions.masks


def test_a_strip_along_the_border_of_measured_depth_is_no_object():
    strip = Box((0.36, 0.03, 0.03), (0.0, -0.27, 0.0))
    depth, index = render([BOX, strip])
    last = np.nonzero(index == 1)[0].max()
    cut = np.where(np.arange(len(depth))[:, None] < last - 2, depth, 0.0)
    regions = geometric_regions(cut, CAMERA, RegionConfig(), np.random.default_rng(0))
    assert last > len(depth) - 16
    assert not regions.may_be_object((index == 1) & (cut > 0))
    assert regions.may_be_object(index == 0)
