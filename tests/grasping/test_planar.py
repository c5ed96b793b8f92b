"""Boundary grasps: pairs are those that a loop over all pairs of boundary cells finds."""

import numpy as np
import pytest

from pipelines.configs import SelectionConfig
from pipelines.formats.gripper_files import load_gripper
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping import planar
from pipelines.grasping.observation import RegionCloud, SceneCloud
from tests.geometry.tabletops import CAMERA, Box, Can, looking_at_table, render

CONFIG = SelectionConfig()
GRIPPER = load_gripper("rg2")


def naive_pairs(view, depth, region, scene):
    """Holding pairs of one slice, (first, second) contact on the plane and quality."""
    inside = planar.cv2.medianBlur((view.depth <= depth).astype(np.uint8), 3)
    boundary, outward = planar._boundary(inside)
    steep = planar._wall_steepness(view, depth, boundary, outward)
    ray = region.view_ray @ view.axes[:, 1:]
    behind = view.points_at(boundary + 2.0 * outward, depth)
    covered = planar._covered(behind, region, scene)
    contact, found = boundary + 0.5 * outward, {}
    for i in range(len(contact)):
        for j in range(i + 1, len(contact)):
            width = np.linalg.norm(contact[j] - contact[i])
            if not CONFIG.min_width < width * view.cell < GRIPPER.max_width:
                continue
            line = (contact[j] - contact[i]) / width
            holding = min(-line @ outward[i], line @ outward[j]) * min(steep[i], steep[j])
            if holding > planar.MIN_HOLDING:
                trusts = [
                    (1.0 - planar.HIDDEN_PENALTY * max(outward[k] @ ray, 0.0))
                    * (planar.COVERED if covered[k] else 1.0)
                    for k in (i, j)
                ]
                found[tuple(contact[i]), tuple(contact[j])] = holding**2 * min(trusts)
    return found


@pytest.mark.parametrize("shape", [Box((0.06, 0.05, 0.1)), Can(0.03, 0.08)])
def test_the_pairs_of_a_slice_are_those_of_a_loop(shape):
    pose = looking_at_table()
    depth, index = render([shape, Box((0.03, 0.03, 0.15), (0.0, -0.08, 0.0))], pose)
    scene = SceneCloud(depth, CAMERA, Plane(pose[:3, 2], float(-pose[:3, 2] @ pose[:3, 3])))
    region = RegionCloud.from_mask(index == 0, scene)
    for approach in planar.approach_directions(region, scene):
        view = planar._HeightMap.of(region.points, approach)
        for at, contact_depth in planar._slice_depths(view, scene, GRIPPER, CONFIG):
            expected = naive_pairs(view, at, region, scene)
            contacts, quality = planar._slice_pairs(
                view, at, contact_depth, region, scene, GRIPPER, CONFIG
            )
            flat = (contacts @ view.axes)[..., 1:]
            cells = (flat - view.low) / view.cell - 0.5
            keys = np.array([np.ravel(pair) for pair in expected]).reshape(-1, 4)
            values = np.array(list(expected.values()))
            assert len(contacts) <= planar.MAX_PAIRS
            assert (len(contacts) > 0) == (len(expected) > 0)
            for pair, value in zip(cells.reshape(-1, 4), quality, strict=True):
                away = np.abs(keys - pair).max(axis=1)
                assert away.min() < 1e-6
                assert values[away.argmin()] == pytest.approx(value)
            if len(expected):
                assert quality.max() == pytest.approx(values.max())
