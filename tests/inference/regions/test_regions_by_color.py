"""Regions by colour: thin objects, objects without depth, and completed regions."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipelines.configs import InferConfig
from pipelines.frames.rgbd import Frame
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.observation import observe
from tests.geometry.tabletops import CAMERA, Box, render
from tests.inference.stand_ins import Detection, Detector

DEPTH, INDEX = render([Box((0.08, 0.08, 0.1))])
TABLE, PAINT = (180, 140, 110), (40, 60, 160)
PEN = np.zeros(DEPTH.shape, np.uint8)
cv2.line(PEN, (40, 150), (110, 190), 1, 9)
PEN = PEN > 0
NOISE = np.random.default_rng(0).normal(0, 0.0008, DEPTH.shape)


def observed(painted, depth=DEPTH, detections=(), **settings):
    color = np.full((*DEPTH.shape, 3), TABLE, np.uint8)
    color[painted] = PAINT
    noisy = np.where(depth > 0, depth + NOISE, 0).astype(np.float32)
    frame = Frame("f", color, noisy, CAMERA)
    config = replace(InferConfig(), **settings)
    return observe(frame, config, np.random.default_rng(0), detector=Detector(list(detections)))


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


def of_color(seen):
    return [region for region in seen.regions if region.source == "color"]


def test_a_pen_below_the_noise_of_depth_is_a_flat_region():
    (pen,) = of_color(observed(PEN))
    assert iou(pen.mask, PEN) > 0.6
    assert pen.status == "flat"


def test_a_small_sticker_is_a_region_in_an_image_that_is_thinned_to_less_than_640_pixels():
    camera = CAMERA.resized(960, 720)
    depth, _ = render([Box((0.08, 0.08, 0.1))], camera=camera)
    color = np.full((*depth.shape, 3), TABLE, np.uint8)
    color[500:522, 200:222] = PAINT
    frame = Frame("f", color, depth.astype(np.float32), camera)
    seen = observe(frame, InferConfig(), np.random.default_rng(0), detector=Detector([]))
    (sticker,) = of_color(seen)
    assert iou(sticker.mask, color[..., 0] == PAINT[0]) > 0.6


@pytest.mark.parametrize(("width", "is_region"), [(2, False), (3, True), (4, True)])
def test_a_pen_of_a_small_image_may_be_thinner_but_a_cable_is_none(width, is_region):
    line = cv2.line(np.zeros(DEPTH.shape, np.uint8), (40, 150), (110, 190), 1, width) > 0
    assert bool(of_color(observed(line))) == is_region


def test_an_object_without_depth_is_a_region_marked_as_such():
    (glass,) = of_color(observed(PEN, np.where(PEN, 0.0, DEPTH)))
    assert iou(glass.mask, PEN) > 0.6
    assert glass.status == "no_depth"


def test_a_region_found_in_depth_is_marked_as_measured_and_not_split():
    seen = observed(INDEX == 0)
    assert [(region.source, region.status) for region in seen.regions] == [
        ("geometric", "measured")
    ]


def test_a_box_whose_right_half_has_no_depth_is_completed():
    right = (INDEX == 0) & (np.arange(320) > np.nonzero(INDEX == 0)[1].mean())
    depth = np.where(right, 0.0, DEPTH)
    plain = replace(InferConfig().region, color=replace(InferConfig().region.color, is_used=False))
    (part,) = observed(INDEX == 0, depth, region=plain).regions
    (whole,) = observed(INDEX == 0, depth).regions
    assert iou(part.mask, INDEX == 0) < 0.7
    assert iou(whole.mask, INDEX == 0) > 0.85


def test_a_shadow_on_the_measured_table_is_not_part_of_a_tall_object():
    shadow = np.zeros(DEPTH.shape, bool)
    rows, columns = np.nonzero(INDEX == 0)
    shadow[rows.max() - 12 : rows.max(), columns.max() : columns.max() + 40] = True
    (box,) = [r for r in observed((INDEX == 0) | shadow).regions if r.source == "geometric"]
    assert iou(box.mask, INDEX == 0) > 0.85


def test_pieces_of_a_low_plate_become_one_region():
    flat, index = render([Box((0.2, 0.2, 0.008))])
    left = (index == 0) & (np.arange(320) < 150)
    right = (index == 0) & (np.arange(320) > 170)
    seen = observed(index == 0, flat, [Detection(left), Detection(right)])
    assert len(seen.regions) == 1
    assert iou(seen.regions[0].mask, index == 0) > 0.85


@pytest.mark.parametrize("regions", ["geometric", "detector"])
def test_colour_is_left_out_where_depth_or_the_detector_alone_is_wanted(regions):
    assert not of_color(observed(PEN, regions=regions))


def test_no_grasp_is_planned_for_regions_found_by_colour_alone():
    color = np.full((*DEPTH.shape, 3), TABLE, np.uint8)
    color[PEN] = PAINT
    frame = Frame("f", color, (DEPTH + NOISE).astype(np.float32), CAMERA)
    config = replace(InferConfig(), method="planar")
    result = Planner(config, load_gripper("rg2")).plan(frame, np.random.default_rng(0))
    flat = np.flatnonzero(result.regions.status == "flat")
    assert len(flat) == 1
    assert not np.isin(result.grasps.region, flat).any()
    assert len(result.grasps)
