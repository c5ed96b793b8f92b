"""The support plane and the objects on it."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.tabletop.footprint import GRID_CELL, Footprint
from pipelines.tabletop.organized import smooth_normals
from pipelines.tabletop.regions.object_criteria import ObjectCriteria
from pipelines.tabletop.regions_geometric import _sound_regions, geometric_regions
from pipelines.tabletop.support_plane import large_parts
from pipelines.tabletop.tabletop import (
    CLEARLY,
    Tabletop,
    _above,
    _near_plane,
    _spread,
    find_tabletop,
)
from tests.geometry.tabletops import CAMERA, Ball, Box, Can, looking_at_table, render

CONFIG = RegionConfig()


def regions_of(depth):
    return geometric_regions(depth, CAMERA, CONFIG, np.random.default_rng(0))


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def best_overlap(regions, mask):
    return max((overlap(region, mask) for region in regions.masks), default=0.0)


@given(st.floats(0.5, 1.5), st.floats(0.6, 1.0))
@settings(max_examples=8, deadline=None)
def test_the_table_is_found_from_any_height(elevation, distance):
    pose = looking_at_table(distance, elevation)
    depth, _ = render([Box((0.06, 0.06, 0.1))], pose)
    top = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    np.testing.assert_allclose(top.plane.normal, pose[:3, 2], atol=5e-3)
    np.testing.assert_allclose(top.plane.offset, -pose[:3, 2] @ pose[:3, 3], atol=3e-3)


@pytest.mark.parametrize("at", [0.001, 0.02, 0.12])  # metres
def test_stray_pixels_near_the_lens_do_not_hide_the_table(at):
    pose = looking_at_table(0.8, 0.8)
    depth, index = render([Box((0.06, 0.06, 0.1))], pose)
    alone = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    stray = np.random.default_rng(1).permutation(depth.size)[: depth.size // 1000]
    depth.ravel()[stray] = at
    top = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    np.testing.assert_allclose(top.plane.normal, alone.plane.normal, atol=2e-3)
    np.testing.assert_allclose(top.plane.offset, alone.plane.offset, atol=1e-3)
    assert overlap(top.foreground, index >= 0) > 0.9


def fingers(depth, share, along):
    """Return `depth` with two fingers from the lower edge that cover a `share` of the image.

    `along`: metres from the lens, at the edge and at the tips.
    """
    (height, width), depth = depth.shape, depth.copy()
    high = int(0.4 * height)
    wide = round(share * height * width / high / 2)
    row = np.linspace(along[1], along[0], high)[:, None]
    noise = np.random.default_rng(1).normal(0.0, 0.0005, (high, wide))
    for left in (width // 5, 4 * width // 5 - wide):
        depth[-high:, left : left + wide] = row + noise * (along[0] != along[1])
    return depth


@pytest.mark.parametrize("along", [(0.12, 0.12), (0.10, 0.18)])
@pytest.mark.parametrize("share", [0.06, 0.15, 0.25])
def test_fingers_of_a_hand_before_the_lens_do_not_hide_the_table(share, along):
    depth, index = render([Box((0.06, 0.06, 0.1))], looking_at_table(0.8, 0.8))
    alone = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    seen = fingers(depth, share, along)
    top = find_tabletop(CAMERA.backproject(seen), CAMERA, CONFIG, np.random.default_rng(0))
    np.testing.assert_allclose(top.plane.normal, alone.plane.normal, atol=2e-3)
    np.testing.assert_allclose(top.plane.offset, alone.plane.offset, atol=1e-3)
    assert not top.foreground[seen != depth].any()
    assert overlap(top.foreground, (index >= 0) & (seen == depth)) > 0.9


def test_the_table_does_not_depend_on_the_random_draws():
    depth, _ = render([Box((0.06, 0.06, 0.1)), Can(0.03, 0.12, (0.15, 0.0, 0.0))])
    depth = depth + (depth > 0) * 0.001 * np.random.default_rng(1).normal(size=depth.shape)
    tops = [
        find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(seed))
        for seed in range(5)
    ]
    for top in tops[1:]:
        np.testing.assert_allclose(top.plane.normal, tops[0].plane.normal, atol=2e-5)
        np.testing.assert_allclose(top.plane.offset, tops[0].plane.offset, atol=2e-5)
        assert (top.foreground != tops[0].foreground).mean() < 1e-4


def test_the_foreground_consists_of_the_objects():
    depth, index = render([Box((0.06, 0.06, 0.1)), Can(0.03, 0.12, (0.15, 0.0, 0.0))])
    top = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    assert overlap(top.foreground, index >= 0) > 0.93


def test_noise_does_not_make_foreground():
    rng = np.random.default_rng(1)
    depth, _ = render([])
    noisy = depth + (depth > 0) * 0.002 * depth**2 * rng.normal(size=depth.shape)
    regions = regions_of(noisy)
    assert regions.foreground.mean() < 0.01
    assert not regions.masks


def test_separate_objects_are_separate_regions():
    shapes = [Box((0.06, 0.05, 0.1), (-0.15, 0, 0)), Can(0.035, 0.1), Ball(0.04, (0.15, 0, 0.04))]
    depth, index = render(shapes)
    regions = regions_of(depth)
    assert len(regions.masks) == 3
    assert all(best_overlap(regions, index == i) > 0.85 for i in range(3))


def test_a_box_on_a_box_is_two_regions():
    shapes = [Box((0.18, 0.14, 0.05)), Box((0.06, 0.06, 0.1), (0.0, 0.0, 0.05), 0.4)]
    depth, index = render(shapes)
    regions = regions_of(depth)
    assert all(best_overlap(regions, index == i) > 0.8 for i in range(2))


def test_convex_edges_do_not_split_an_object():
    depth, index = render([Box((0.1, 0.08, 0.12), yaw=0.6)])
    regions = regions_of(depth)
    assert len(regions.masks) == 1
    assert best_overlap(regions, index == 0) > 0.9


@pytest.mark.parametrize(
    ("size", "count"), [((0.30, 0.05, 0.2), 1), ((0.25, 0.25, 0.2), 1), ((0.4, 0.2, 0.2), 0)]
)
def test_an_object_is_a_region_up_to_a_diagonal_of_45_centimetres(size, count):
    depth, _ = render([Box(size, (0, 0.1, 0))])
    assert len(regions_of(depth).masks) == count
    assert (np.linalg.norm(size) < CONFIG.max_extent) == count


def from_above(height=0.7):
    """T_cam_table of a camera straight above the table's middle."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = height
    return pose


@pytest.mark.parametrize("off", [0.0, 0.04, 0.08, 0.12])
@pytest.mark.parametrize("height", [0.03, 0.06, 0.12])
def test_an_object_beneath_the_camera_is_found_although_its_sides_are_not_seen(height, off):
    depth, index = render([Box((0.08, 0.08, height), (off, 0.0, 0.0))], from_above())
    regions = regions_of(depth)
    assert len(regions.masks) == 1
    assert overlap(regions.masks[0], index == 0) > 0.85


@pytest.mark.parametrize("pose", [from_above(), looking_at_table()], ids=["above", "aside"])
def test_an_object_over_the_table_is_no_region_where_the_table_is_seen_beneath(pose):
    depth, _ = render([Ball(0.04, (0.12, 0.1, 0.2))], pose)
    beneath = regions_of(depth).masks
    assert len(beneath) == 0


@pytest.mark.parametrize("axis", [0, 1])
def test_depth_in_a_single_row_or_column_shows_no_table(axis):
    depth = np.zeros((240, 320))
    depth[(100, slice(None)) if axis == 0 else (slice(None), 100)] = 0.7
    top = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    assert top.plane is None


def test_a_turned_image_is_thinned_like_the_upright_one():
    camera = Intrinsics(1048.0, 1048.0, 639.5, 479.5, 1280, 960)
    depth, _ = render([Box((0.06, 0.06, 0.1)), Can(0.03, 0.1, (0.15, 0, 0))], camera=camera)
    upright = Intrinsics(1048.0, 1048.0, 479.5, 639.5, 960, 1280)
    turned = np.ascontiguousarray(np.rot90(depth))
    rng = np.random.default_rng(0)
    first = geometric_regions(depth, camera, CONFIG, rng).labels
    second = geometric_regions(turned, upright, CONFIG, np.random.default_rng(0)).labels
    assert first.max() == second.max() == 2
    assert ((np.rot90(first) > 0) == (second > 0)).mean() > 0.999


def test_a_frame_without_depth_has_no_regions():
    regions = regions_of(np.zeros((240, 320)))
    assert regions.plane is None
    assert not regions.masks


def test_the_same_seed_gives_the_same_regions():
    depth, _ = render([Box((0.06, 0.06, 0.1)), Can(0.03, 0.12, (0.15, 0.0, 0.0))])
    np.testing.assert_array_equal(regions_of(depth).labels, regions_of(depth).labels)


@pytest.mark.parametrize("radius", [2, 4])
def test_smooth_normals_of_a_plane_are_its_normal(radius):
    pose = looking_at_table()
    depth, _ = render([], pose)
    normals = smooth_normals(CAMERA.backproject(depth), depth > 0, radius)
    inside = normals[60:180, 80:240]
    np.testing.assert_allclose(inside, np.broadcast_to(pose[:3, 2], inside.shape), atol=1e-6)


@given(st.integers(0, 2**31), st.integers(3, 400), st.sampled_from([0.0, 0.03]))
@settings(max_examples=25, deadline=None)
def test_a_footprint_is_the_hull_of_all_points_widened(seed, count, margin):
    rng = np.random.default_rng(seed)
    plane = Plane(unit(rng.normal(size=3)), 0.0)
    points = rng.normal(0, 0.1, (count, 3))
    found = Footprint.around(points, plane, margin)
    cells = ((points @ found.axes - found.low) / GRID_CELL).astype(np.int32)
    expected = np.zeros_like(found.cells)
    cv2.fillConvexPoly(expected, cv2.convexHull(cells), 1)
    if margin:
        expected = cv2.dilate(expected, np.ones((7, 7), np.uint8))
    np.testing.assert_array_equal(found.cells, expected)
    assert found.contains(points).all()


PLANE = Plane(unit([0.1, -0.6, -0.8]), 0.7)


def affine(plane):
    """Return a, b and c of the plane's inverse depth a u + b v + c."""
    # A pixel's point on the plane is its ray of depth 1, times the plane's depth there.
    inverse = -CAMERA.rays() @ plane.normal / plane.offset
    return inverse[0, 1] - inverse[0, 0], inverse[1, 0] - inverse[0, 0], inverse[0, 0]


@pytest.mark.parametrize("share", [0.0, 0.7])
def test_pixels_above_the_table_are_high_over_its_flattened_plane(share):
    rng = np.random.default_rng(0)
    z = rng.uniform(0.4, 1.2, (CAMERA.height, CAMERA.width))
    warp = rng.normal(0.0, 0.01, z.shape)
    near = rng.random(z.shape) < share
    top = Tabletop(PLANE, near, near, near, 0.01)
    height = PLANE.height(CAMERA.backproject(1.0 / (1.0 / z - warp)))
    threshold = top.threshold(z, CONFIG)
    limits = CONFIG.min_height, top.height_noise, CONFIG.max_height
    above, clear = _above(z, near, warp, affine(PLANE), PLANE.offset, limits)
    expected = near & (height > threshold) & (height < CONFIG.max_height)
    np.testing.assert_array_equal(above, expected)
    np.testing.assert_array_equal(clear, near & (height > CLEARLY * threshold))
    assert above.any() == (share > 0)


def test_pixels_near_the_plane_have_the_inverse_depth_of_the_plane():
    rng = np.random.default_rng(1)
    z = rng.uniform(0.4, 1.2, (CAMERA.height, CAMERA.width))
    z[rng.random(z.shape) < 0.1] = np.nan
    near = (z > 0) & (rng.random(z.shape) < 0.8)
    residual, inliers = _near_plane(z, near, affine(PLANE), 0.1)
    expected = 1.0 / z + CAMERA.rays() @ PLANE.normal / PLANE.offset
    np.testing.assert_array_equal(inliers, near & (np.abs(expected) < 0.1))
    np.testing.assert_allclose(residual, np.where(inliers, expected, 0.0), atol=1e-12)
    assert inliers.any()


@given(st.integers(0, 2**31), st.integers(1, 9), st.integers(1, 9), st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_a_spread_is_every_second_pixel_of_a_mask_or_all_without_one(seed, height, width, share):
    mask = np.random.default_rng(seed).random((height, width)) < share
    thin = np.zeros_like(mask)
    thin[::2, ::2] = mask[::2, ::2]
    np.testing.assert_array_equal(_spread(mask), np.flatnonzero(thin if thin.any() else mask))


@given(st.integers(0, 2**31), st.integers(0, 6))
@settings(max_examples=25, deadline=None)
def test_large_parts_have_over_a_tenth_of_the_largest_area(seed, count):
    sizes = np.random.default_rng(seed).integers(2, 25, (count, 2))
    mask, expected = np.zeros((2, 40, 240), np.bool_)
    for place, (height, width) in enumerate(sizes):
        part = slice(8, 8 + height), slice(40 * place + 8, 40 * place + 8 + width)
        mask[part] = True
        expected[part] = height * width > 0.1 * sizes.prod(axis=1).max()
    np.testing.assert_array_equal(large_parts(mask.view(np.uint8)), expected)


@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.03]))
@settings(max_examples=25, deadline=None)
def test_a_footprint_contains_the_points_over_its_cells(seed, margin):
    rng = np.random.default_rng(seed)
    plane = Plane(unit(rng.normal(size=3)), 0.0)
    table = Footprint.around(rng.normal(0, 0.1, (30, 3)), plane, margin)
    points = rng.normal(0, 0.2, (200, 3))
    found = table.contains(points)
    for point, inside in zip(points, found, strict=True):
        column, row = np.floor((point @ table.axes - table.low) / GRID_CELL).astype(int)
        height, width = table.cells.shape
        over = 0 <= column < width and 0 <= row < height and table.cells[row, column] > 0
        assert inside == over


@pytest.mark.parametrize("seed", range(3))
def test_smooth_normals_are_planes_fitted_pixel_by_pixel(seed):
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:24, :30]
    depth = 0.6 + 0.002 * u + 0.001 * v + rng.normal(0, 0.0005, u.shape)
    camera = Intrinsics(40.0, 41.0, 15.0, 11.0, 30, 24)
    xyz = camera.backproject(np.where(rng.random(u.shape) < 0.1, 0.0, depth))
    mask = rng.random(u.shape) < 0.8
    found = smooth_normals(xyz, mask, 2)
    known = mask & np.isfinite(xyz[..., 2])
    for row, column in np.argwhere(known):
        window = slice(max(0, row - 2), row + 3), slice(max(0, column - 2), column + 3)
        points = xyz[window][known[window]]
        if len(points) < 6:
            assert np.isnan(found[row, column]).all()
            continue
        design = np.column_stack([points[:, :2] / points[:, 2:], np.ones(len(points))])
        plane = np.linalg.lstsq(design, 1.0 / points[:, 2], rcond=None)[0]
        np.testing.assert_allclose(found[row, column], -unit(plane), atol=1e-6)
    assert np.isnan(found[~known]).all()


def test_labels_with_gaps_give_the_same_regions():
    pose = looking_at_table()
    depth, index = render([Box((0.06, 0.05, 0.1), (-0.15, 0, 0)), Can(0.035, 0.1)], pose)
    xyz = CAMERA.backproject(depth)
    top = find_tabletop(xyz, CAMERA, CONFIG, np.random.default_rng(0))
    labels = np.where(top.foreground, np.select([index == 0, index == 1], [3, 70], 0), 0)
    criteria = ObjectCriteria(xyz, top, np.zeros(labels.shape, bool), CONFIG)
    found = _sound_regions(labels.astype(np.int32), criteria)
    assert sorted(np.unique(found)) == [0, 1, 2]
    for number in (1, 2):
        assert len(np.unique(labels[(found == number) & (labels > 0)])) == 1


@pytest.mark.parametrize(
    "shape", [Box((0.06, 0.09, 0.1)), Box((0.12, 0.1, 0.06)), Can(0.035, 0.12)]
)
def test_the_lid_of_an_object_is_no_table_if_it_alone_has_depth(shape):
    depth, index = render([shape])
    found = regions_of(np.where(index == 0, depth, 0.0))
    assert found.plane is None
    assert best_overlap(found, index == 0) > 0.9


@pytest.mark.parametrize("shape", [None, Box((0.4, 0.5, 0.03))])  # a board with a visible edge
def test_an_empty_table_is_found(shape):
    depth, index = render([shape] if shape else [])
    depth = depth if shape is None else np.where(index == 0, depth, 0.0)
    found = regions_of(depth)
    assert found.plane is not None
    assert not found.masks


def test_a_cable_next_to_a_tray_of_its_height_does_not_widen_the_tray():
    depth = np.full((CAMERA.height, CAMERA.width), 0.8, np.float32)
    depth[20:220, 65:240] = 0.7  # the tray, on a bench
    depth[100:120, 300:305] = 0.7  # the cable
    top = find_tabletop(CAMERA.backproject(depth), CAMERA, CONFIG, np.random.default_rng(0))
    np.testing.assert_allclose(top.plane.offset, 0.7, atol=1e-3)
