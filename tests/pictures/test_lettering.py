"""Letters with a halo."""

import cv2
import numpy as np
import pytest

from pipelines.pictures.lettering import write_with_halo

INKS = (250, 200, 100), (0, 0, 0)


@pytest.mark.parametrize("place", [(-5000, 30), (100, 30), (10, -400), (10, 5000)])
def test_text_beside_the_picture_changes_nothing(place):
    picture = np.full((60, 80, 3), 120, np.uint8)
    write_with_halo(picture, "12", place, 0.5, INKS, weight=1, rim=1)
    assert (picture == 120).all()


def test_text_across_an_edge_is_cut_off():
    whole, cut = np.full((60, 80, 3), 120, np.uint8), np.full((60, 60, 3), 120, np.uint8)
    write_with_halo(whole, "12", (15, 30), 0.5, INKS, weight=1, rim=1)
    write_with_halo(cut, "12", (-5, 30), 0.5, INKS, weight=1, rim=1)
    assert (cut[:, 0] != 120).any()
    np.testing.assert_array_equal(cut[:, 1:], whole[:, 21:])


@pytest.mark.parametrize(("scale", "weight", "rim"), [(0.4, 1, 1), (1.0, 2, 2), (3.0, 6, 6)])
def test_the_halo_goes_evenly_around_the_letters(scale, weight, rim):
    picture = np.full((150, 600, 3), 120, np.uint8)
    write_with_halo(picture, "10: 0.98", (20, 100), scale, INKS, weight=weight, rim=rim)
    bare = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(
        bare, "10: 0.98", (20, 100), cv2.FONT_HERSHEY_SIMPLEX, scale, 255, weight, cv2.LINE_AA
    )
    np.testing.assert_array_equal((picture == INKS[0]).all(axis=-1), bare == 255)
    away = cv2.distanceTransform((bare == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    assert (picture[away > rim + 0.5] == 120).all()
    core = cv2.distanceTransform((bare < 255).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    assert (picture[(bare == 0) & (core <= rim)] == 0).all()
