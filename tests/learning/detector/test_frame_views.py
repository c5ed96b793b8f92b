"""Random views of a detector's frame keep geometry and regions together."""

import numpy as np
import pytest

from pipelines.dataset.training.detector_frames import DetectorFrame
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.learning.detector.frame_views import (
    as_example,
    mirrored,
    noisy_depth,
    random_colors,
    random_view,
    with_lost_stream,
    zoomed,
)
from pipelines.tabletop.depth_channels import SmallFrame

CAMERA = Intrinsics(120.0, 120.0, 60.0, 44.0, 128, 96)


@pytest.fixture
def view():
    """A table seen at a slant with a slab of 5 cm on it, off the middle."""
    plane = Plane(np.array([0.0, -0.6, -0.8]), 0.6)
    rays = CAMERA.rays()
    depth = -plane.offset / (rays @ plane.normal)
    raised = (plane.offset - 0.05) / -(rays @ plane.normal)
    regions = np.zeros((96, 128), np.uint8)
    regions[30:60, 20:50] = 1
    depth = np.where(regions > 0, raised, depth).astype(np.float32)
    color = np.random.default_rng(0).integers(0, 255, (96, 128, 3), np.uint8)
    return DetectorFrame(SmallFrame(color, depth, CAMERA), plane, regions)


def heights(view):
    return view.plane.height(view.frame.intrinsics.backproject(view.frame.depth))


@pytest.mark.parametrize("zoom", [1.0, 1.3, 1.5])
def test_the_slab_keeps_its_height_over_the_table_in_every_view(view, zoom):
    moved = zoomed(mirrored(view), zoom, np.random.default_rng(1))
    height = heights(moved)
    inside = moved.regions > 0
    assert inside.any()
    assert np.nanmedian(np.abs(height[inside] - 0.05)) < 0.003
    assert np.nanmedian(np.abs(height[~inside])) < 0.003


def test_mirroring_twice_gives_the_frame_back(view):
    again = mirrored(mirrored(view))
    assert np.array_equal(again.frame.depth, view.frame.depth)
    assert again.frame.intrinsics == view.frame.intrinsics


def test_noise_removes_depth_and_never_adds_any(view):
    depth = view.frame.depth.copy()
    depth[:10] = 0.0
    noisy = noisy_depth(depth, np.random.default_rng(0))
    assert not noisy[:10].any()
    assert (noisy >= 0).all()
    assert np.abs(noisy - depth)[noisy > 0].max() < 0.03


def test_an_example_has_a_box_around_each_mask(view):
    example = as_example(view, "both")
    assert example.image.shape == (9, 96, 128)
    assert example.target["boxes"].tolist() == [[20.0, 30.0, 50.0, 60.0]]
    assert int(example.target["masks"].sum()) == 900


def test_the_same_seed_gives_the_same_view(view):
    one, two = (random_view(view, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.frame.depth, two.frame.depth)
    assert np.array_equal(one.frame.color, two.frame.color)


def test_colors_change_and_stay_colors(view):
    before = view.frame.color
    for seed in range(8):
        after = random_colors(before, np.random.default_rng(seed))
        assert after.dtype == np.uint8
        assert after.shape == before.shape
        assert (after != before).any()


def test_one_stream_is_sometimes_dropped_and_never_both(view):
    image = as_example(view, "both").image
    lost = {"color": 0, "geometry": 0}
    for seed in range(200):
        seen = with_lost_stream(image, "both", np.random.default_rng(seed))
        color, geometry = not seen[:3].any(), not seen[3:-1].any()
        assert not (color and geometry)
        assert not geometry or (seen[-1] == 1.0).all()
        lost["color"] += color
        lost["geometry"] += geometry
    assert all(8 < count < 45 for count in lost.values())
    alone = as_example(view, "geometry").image
    assert with_lost_stream(alone, "geometry", np.random.default_rng(0)) is alone
