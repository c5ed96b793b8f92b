"""Regions of a frame: of the detector, of the depth, of the user's masks."""

import tracemalloc
from dataclasses import replace

import numpy as np

from pipelines.configs import InferConfig
from pipelines.frames.rgbd import Frame
from pipelines.inference.observation import observe
from tests.geometry.tabletops import CAMERA, Box, Can, Cup, looking_at_table, render
from tests.inference.stand_ins import Detection, Detector

SHAPES = [Box((0.06, 0.09, 0.1)), Can(0.035, 0.12, (0.15, 0, 0))]
DEPTH, INDEX = render(SHAPES)
FRAME = Frame("f", np.zeros((240, 320, 3), np.uint8), DEPTH.astype(np.float32), CAMERA)


def regions(detector, **settings):
    config = replace(InferConfig(), **settings)
    return observe(FRAME, config, np.random.default_rng(0), detector=detector).regions


def test_auto_adds_regions_that_the_detector_left_uncovered():
    found = regions(Detector([Detection(INDEX == 0)]))
    assert [region.source for region in found] == ["detector", "geometric"]
    assert (found[1].mask & (INDEX == 1)).sum() > 0.8 * (INDEX == 1).sum()


def test_the_table_is_found_once_for_all():
    detector = Detector([])
    seen = observe(FRAME, InferConfig(), np.random.default_rng(0), detector=detector)
    assert seen.scene.plane is not None
    assert detector.planes == [seen.scene.plane]


def test_the_detector_alone_is_not_completed():
    found = regions(Detector([Detection(INDEX == 0)]), regions="detector")
    assert [region.source for region in found] == ["detector"]


def test_detections_of_the_table_are_dropped():
    table = np.zeros(DEPTH.shape, bool)
    table[200:230, 20:80] = True
    assert not regions(Detector([Detection(table & (INDEX < 0))]), regions="detector")


def test_overlapping_detections_go_to_the_more_confident():
    both = Detector([Detection(INDEX >= 0, 0.6), Detection(INDEX == 0, 0.9)])
    found = regions(both, regions="detector")
    assert [region.confidence for region in found] == [0.9, 0.6]
    assert not (found[0].mask & found[1].mask).any()


def test_small_detections_are_dropped():
    speck = np.zeros(DEPTH.shape, bool)
    rows, columns = np.nonzero(INDEX == 0)
    speck[rows[:50], columns[:50]] = True
    assert not regions(Detector([Detection(speck)]), regions="detector")


def masked(depth, masks):
    frame = replace(FRAME, depth=depth.astype(np.float32))
    return observe(frame, InferConfig(), np.random.default_rng(0), masks=masks)


def test_a_lid_in_the_masks_is_not_taken_for_the_table():
    masks = (INDEX + 1).astype(np.int32)
    whole, cut = masked(DEPTH, masks), masked(np.where(masks > 0, DEPTH, 0.0), masks)
    assert len(whole.regions) == len(cut.regions) == len(SHAPES)
    plane = observe(FRAME, InferConfig(), np.random.default_rng(0)).scene.plane
    np.testing.assert_allclose(whole.scene.plane.normal, plane.normal, atol=1e-3)
    np.testing.assert_allclose(whole.scene.plane.offset, plane.offset, atol=1e-3)
    assert cut.scene.plane is None


def test_a_small_part_of_the_table_around_the_masks_is_enough():
    masks = (INDEX + 1).astype(np.int32)
    table = np.zeros(DEPTH.shape, bool)
    table[60:180:2, 40:280:2] = True
    found = masked(np.where((masks > 0) | table, DEPTH, 0.0), masks)
    whole = masked(DEPTH, masks)
    np.testing.assert_allclose(found.scene.plane.normal, whole.scene.plane.normal, atol=0.01)
    np.testing.assert_allclose(found.scene.plane.offset, whole.scene.plane.offset, atol=0.01)


def test_a_detection_keeps_pixels_of_the_table_if_it_is_not_clipped():
    wide = np.zeros(DEPTH.shape, bool)
    rows, columns = np.nonzero(INDEX == 0)
    wide[rows.min() - 8 : rows.max() + 8, columns.min() - 8 : columns.max() + 8] = True
    clipped, whole = (
        regions(
            Detector([Detection(wide)]),
            regions="detector",
            clip_detections=clip,
            min_foreground=0.0,
        )[0].mask
        for clip in (True, False)
    )
    np.testing.assert_array_equal(whole, wide)
    assert clipped.sum() < 0.9 * wide.sum()


def test_the_only_detection_in_a_segment_takes_the_rest_of_it():
    box = INDEX == 0
    rows = np.arange(240)[:, None]
    upper = box & (rows < np.quantile(np.nonzero(box)[0], 0.65))
    found = regions(Detector([Detection(upper)]))
    assert (found[0].mask & box).sum() > 0.95 * box.sum()
    assert sum((region.mask & box).any() for region in found) == 1


def test_a_wide_rest_of_a_segment_between_detections_is_a_region():
    depth, index = render([Box((0.3, 0.06, 0.05))])
    columns = np.nonzero(index == 0)[1]
    u = np.arange(320)[None, :]

    def left_of(gap):
        """Return the sources of regions, where two detections leave a `gap` between them."""
        middle = np.median(columns)
        parts = [(index == 0) & (u < middle - gap / 2), (index == 0) & (u > middle + gap / 2)]
        frame = replace(FRAME, depth=depth.astype(np.float32))
        detector = Detector([Detection(part) for part in parts])
        seen = observe(frame, InferConfig(), np.random.default_rng(0), detector=detector)
        return [region.source for region in seen.regions]

    assert left_of(gap=40) == ["detector", "detector", "geometric"]
    assert left_of(gap=10) == ["detector", "detector"]


def test_the_outside_and_the_inside_of_a_cup_are_one_region():
    pose = looking_at_table(elevation=0.7)
    depth, index = render([Cup(0.045, 0.08), Cup(0.045, 0.08, inside=True)], pose)
    frame = replace(FRAME, depth=depth.astype(np.float32))
    detector = Detector([Detection(index == 0), Detection(index == 1)])
    seen = observe(frame, InferConfig(), np.random.default_rng(0), detector=detector)
    assert len(seen.regions) == 1
    assert (seen.regions[0].mask & (index >= 0)).sum() > 0.95 * (index >= 0).sum()


def test_thousands_of_small_instances_need_little_memory():
    masks = np.arange(2, INDEX.size + 2, dtype=np.int32).reshape(INDEX.shape)
    masks[20:] = 0
    masks[INDEX == 0] = 1
    tracemalloc.start()
    try:
        seen = masked(DEPTH, masks)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(seen.regions) == 1
    assert seen.too_small == len(np.unique(masks[masks > 1]))
    assert peak < 100e6  # a mask of each instance takes 490 MB
