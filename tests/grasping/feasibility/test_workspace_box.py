"""The workspace that `workspace` suggests around the regions of a frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.feasibility.workspace_box import WorkspaceBox, suggested_box
from pipelines.tabletop.levelling import table_from_camera

# 101 points each along a line: the first and the last percent are strays.
LINE = np.linspace(0.0, 1.0, 101)[:, None]
CLOUDS = [LINE * [0.1, 0.2, 0.1] + [0.0, 0.0, 0.02], LINE * [0.1, 0.1, 0.3] + [0.2, -0.1, 0.02]]


@pytest.mark.parametrize("has_table", [False, True])
def test_the_box_is_a_margin_wider_than_the_bulk_of_all_regions_but_not_below_the_table(has_table):
    table = Plane(np.array([0.0, -0.6, -0.8]), 0.7)
    clouds = CLOUDS
    if has_table:
        clouds = [transform_points(invert(table_from_camera(table)), each) for each in CLOUDS]
    box = suggested_box(clouds, table if has_table else None, 0.05)
    # Lowest x: 0.001 - 0.05, rounded outward to centimetres; highest z: 0.317 + 0.05.
    low = [-0.05, -0.15, -0.01 if has_table else -0.03]
    assert_allclose(box.corners, [low, [0.35, 0.25, 0.37]], atol=1e-9)
    assert box.frame == ("table" if has_table else "camera")
    assert box.contains(np.concatenate(clouds)).all()


def test_the_options_of_a_box_have_its_millimetres():
    corners = np.array([[-0.0, 0.004, -0.1], [0.1 + 0.2, 0.0085, 1.0]])
    box = WorkspaceBox(corners, "table", np.eye(4))
    numbers = "0.00,0.004,-0.10,0.30,0.0085,1.00"
    assert box.options == f"--workspace={numbers} --workspace-frame table"
