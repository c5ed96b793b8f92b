"""Regions in small images: those of a larger image of the same view."""

import numpy as np
import pytest

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.tabletop.regions_geometric import FEWEST_PIXELS, geometric_regions, least_pixels
from tests.geometry.tabletops import Box, looking_at_table, render

BOXES = [Box((0.04, 0.04, 0.05), (x, 0.0, 0.0)) for x in (-0.12, 0.0, 0.12)]


@pytest.mark.parametrize("width", [160, 320, 640, 1280])
def test_small_boxes_are_regions_in_an_image_of_any_size(width):
    height, focal = width * 3 // 4, 0.75 * width
    camera = Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    depth, _ = render(BOXES, looking_at_table(0.65, 0.8), camera)
    found = geometric_regions(depth, camera, RegionConfig(), np.random.default_rng(0))
    assert len(found.masks) == len(BOXES)


@pytest.mark.parametrize("width", [640, 960, 1280])
def test_an_image_that_is_thinned_to_less_than_640_pixels_needs_fewer_pixels(width):
    height, focal = width * 3 // 4, 0.75 * width
    camera = Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    cube = Box((0.02, 0.02, 0.02), (0.05, 0.0, 0.0))
    depth, _ = render([cube], looking_at_table(0.65, 0.8), camera)
    found = geometric_regions(depth, camera, RegionConfig(), np.random.default_rng(0))
    assert len(found.masks) == 1


def test_the_least_number_of_pixels_follows_the_area_of_smaller_images():
    assert least_pixels(200, (480, 640)) == least_pixels(200, (1080, 1920)) == 200
    assert least_pixels(200, (240, 320)) == least_pixels(200, (320, 240)) == 50
    assert least_pixels(200, (60, 80)) == FEWEST_PIXELS
    assert least_pixels(10, (240, 320)) == 10  # the user's own limit
