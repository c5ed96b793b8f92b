"""Pieces that stand out from a table by colour."""

from dataclasses import replace

import cv2
import numpy as np

from pipelines.configs import ColorConfig
from pipelines.tabletop.regions.color import color_pieces, table_outline

SHAPE = (240, 320)
TABLE = (180, 140, 110)
BARE = np.zeros(SHAPE, bool)
BARE[20:220, 20:300] = True


def image(noise=1.5):
    rng = np.random.default_rng(0)
    light = np.linspace(0.7, 1.2, SHAPE[1])[None, :, None]  # a lamp on the right
    return np.clip(np.array(TABLE) * light + rng.normal(0, noise, (*SHAPE, 3)), 0, 255)


def with_line(start, end, color, width):
    picture = image()
    cv2.line(picture, start, end, color, width)
    return picture.astype(np.uint8)


def pieces(picture, bare=BARE, **settings):
    return color_pieces(np.asarray(picture, np.uint8), bare, replace(ColorConfig(), **settings))


def test_a_bare_table_in_uneven_light_has_no_pieces():
    assert pieces(image()).labels.max() == 0


def test_a_pen_of_another_colour_is_one_piece():
    found = pieces(with_line((60, 60), (160, 90), (40, 60, 160), 8))
    true = with_line((60, 60), (160, 90), (0, 0, 0), 8).sum(-1) == 0
    assert found.may_be_object.tolist() == [False, True]
    both = (found.labels == 1) & true
    assert both.sum() > 0.7 * ((found.labels == 1) | true).sum()


def test_a_piece_that_reaches_over_the_edge_of_the_table_is_no_object():
    found = pieces(with_line((10, 60), (160, 90), (40, 60, 160), 8))
    assert found.may_be_object.tolist() == [False, False]


def test_a_line_such_as_a_cable_or_a_joint_is_no_object():
    found = pieces(with_line((40, 60), (280, 90), (30, 30, 30), 2))
    assert not found.may_be_object.any()


def test_a_cable_does_not_join_the_objects_it_connects():
    picture = with_line((60, 60), (280, 180), (30, 30, 30), 3)
    cv2.circle(picture, (60, 60), 16, (30, 30, 30), -1)
    cv2.circle(picture, (280, 180), 14, (30, 30, 30), -1)
    cv2.polylines(picture, [np.array([(60, 60), (250, 40), (280, 180)])], False, (30, 30, 30), 3)
    found = pieces(picture)
    assert found.labels[60, 60] != found.labels[180, 280]


def test_the_pattern_of_a_table_is_not_taken_for_objects():
    squares = np.indices(SHAPE).sum(0) // 10 % 2 == 0
    picture = np.where(squares[..., None], (230, 230, 230), (90, 50, 30))
    assert not pieces(picture).may_be_object.any()


def test_without_colour_or_without_a_table_there_are_no_pieces():
    grey = np.zeros((*SHAPE, 3))
    assert pieces(grey).labels.max() == 0
    pen = with_line((60, 60), (160, 90), (40, 60, 160), 8)
    assert pieces(pen, np.zeros(SHAPE, bool)).labels.max() == 0


def test_the_outline_includes_the_parts_of_a_table_and_no_speck():
    bare = BARE.copy()
    bare[:, 100:120] = False
    bare[230:234, 310:314] = True
    outline = table_outline(bare)
    assert outline[100, 110]
    assert not outline[232, 312]
