"""Planar labels are the free grasps along the view axis, drawn as rectangles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.dataset.graspnet.graspnet_labels import (
    LABEL_GRID,
    GraspLabel,
    chosen_grasps,
    label_offsets,
)
from pipelines.dataset.graspnet.graspnet_views import generate_views, view_rotations
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import make_pose
from pipelines.synthesis.labels.planar_labels import planar_rows

CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
DOWN = int(np.argmin(generate_views()[:, 2]))  # a view from below: it approaches along +z
WIDTH, FRICTION = 0.06, 0.3


def free(label, collision):
    return chosen_grasps(label, (label.min_friction > 0) & ~collision)


def label_with(candidates):
    shape = (1, *LABEL_GRID)
    friction, width = np.full(shape, -1.0, np.float32), np.zeros(shape, np.float32)
    for candidate in candidates:
        friction[(0, *candidate)], width[(0, *candidate)] = FRICTION, WIDTH
    return GraspLabel(np.zeros((1, 3), np.float32), label_offsets(width), friction < 0, friction)


@pytest.fixture
def pose():
    """A pose in which view DOWN approaches exactly along the camera's z axis."""
    turned = view_rotations()[DOWN, 0].astype(np.float64)  # columns approach, closing, third
    to_camera = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], np.float64)
    return make_pose(to_camera @ turned.T, [0.0, 0.0, 0.52])


def test_a_grasp_along_the_axis_becomes_its_rectangle(pose):
    label = label_with([(DOWN, 0, 1)])
    rows = planar_rows(7, free(label, label.collision), pose, CAMERA)
    # At 0.5 m, 2 cm before the origin: the opening is 72 pixels, the height 24.
    assert_allclose(rows, [[319.5, 239.5, 283.5, 239.5, 24.0, 0.8, 7.0]], atol=1e-3)


def test_a_grasp_from_the_side_has_no_rectangle(pose):
    side = int(np.argmin(np.abs(generate_views() @ generate_views()[DOWN])))
    label = label_with([(side, 0, 0)])
    assert planar_rows(0, free(label, label.collision), pose, CAMERA).shape == (0, 7)


def test_colliding_grasps_have_no_rectangle(pose):
    label = label_with([(DOWN, 0, 1), (DOWN, 3, 0)])
    collision = label.collision.copy()
    collision[0, DOWN, 3, 0] = True
    assert len(planar_rows(0, free(label, label.collision), pose, CAMERA)) == 2
    assert len(planar_rows(0, free(label, collision), pose, CAMERA)) == 1


def test_rectangles_outside_the_image_are_left_out(pose):
    label = label_with([(DOWN, 0, 1)])
    pose[:3, 3] = [0.5, 0.0, 0.52]
    assert planar_rows(0, free(label, label.collision), pose, CAMERA).shape == (0, 7)
