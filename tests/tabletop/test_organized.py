"""Normals of a depth image's pixels, also in cut windows and without a plane."""

import numpy as np
import pytest

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import unit
from pipelines.tabletop.organized import image_normals, smooth_normals

CAMERA = Intrinsics(600.0, 580.0, 15.0, 11.0, 30, 24)
RADIUS = 3


def bent_surface():
    v, u = np.mgrid[:24, :30]
    noise = np.random.default_rng(0).normal(0, 0.0005, u.shape)
    return CAMERA.backproject(0.6 + 0.002 * u + 0.0001 * (v - 12) ** 2 + noise)


def fitted_about(xyz, mask, row, column):
    """Return the normal of the plane fitted to the pixels in the square around one pixel."""
    window = tuple(slice(max(0, place - RADIUS), place + RADIUS + 1) for place in (row, column))
    points = xyz[window][mask[window]]
    design = np.column_stack([points[:, :2] / points[:, 2:], np.ones(len(points))])
    return -unit(np.linalg.lstsq(design, 1.0 / points[:, 2], rcond=None)[0])


@pytest.mark.parametrize("share", [1.0, 0.97])
def test_whole_and_cut_windows_give_the_plane_fitted_to_their_pixels(share):
    xyz = bent_surface()
    mask = np.random.default_rng(1).random(xyz.shape[:2]) < share
    found = smooth_normals(xyz, mask, RADIUS)
    for row, column in np.argwhere(mask):
        expected = fitted_about(xyz, mask, row, column)
        np.testing.assert_allclose(found[row, column], expected, atol=1e-6)


def test_a_part_of_the_image_gives_the_normals_of_the_whole():
    xyz = bent_surface()
    mask = np.zeros(xyz.shape[:2], bool)
    mask[5:20, 9:25] = np.random.default_rng(2).random((15, 16)) < 0.8
    part = slice(5, 20), slice(9, 25)
    whole = smooth_normals(xyz, mask, RADIUS)
    np.testing.assert_allclose(smooth_normals(xyz[part], mask[part], RADIUS), whole[part])


def test_a_depth_image_gives_the_normals_of_its_points():
    xyz = bent_surface()
    x = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    y = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy
    expected = smooth_normals(xyz, np.ones(xyz.shape[:2], bool), RADIUS)
    found = image_normals(xyz[..., 2], x, y, RADIUS)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("line", ["row", "column", "diagonal"])
def test_pixels_on_one_line_have_no_normal(line):
    mask = np.zeros((24, 30), bool)
    place = np.arange(24)
    rows, columns = {
        "row": (8, place),
        "column": (place, 8),
        "diagonal": (place, place),
    }[line]
    mask[rows, columns] = True
    assert np.isnan(smooth_normals(bent_surface(), mask, RADIUS)).all()


def test_few_pixels_or_none_have_no_normal():
    mask = np.zeros((24, 30), bool)
    assert np.isnan(smooth_normals(bent_surface(), mask, RADIUS)).all()
    mask[4:6, 4:6] = True
    assert np.isnan(smooth_normals(bent_surface(), mask, RADIUS)).all()


def test_missing_depth_is_no_part_of_a_fit():
    xyz = bent_surface()
    missing = np.random.default_rng(3).random(xyz.shape[:2]) < 0.2
    holed = np.where(missing[..., None], np.nan, xyz)
    found = smooth_normals(holed, np.ones_like(missing), RADIUS)
    np.testing.assert_array_equal(found, smooth_normals(xyz, ~missing, RADIUS))
