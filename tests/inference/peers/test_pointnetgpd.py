"""PointNetGPD on a frame, with a stand-in for the network."""

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.frames.rgbd import Frame
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference.peers.pointnetgpd import PointNetGPDMethod, scene_hands
from pipelines.network.peers.pointnetgpd import PointNetGPD
from tests.geometry.tabletops import CAMERA, Box, Can
from tests.grasping.seen_regions import seen

RG2 = load_gripper("rg2")


class FullerIsBetter(PointNetGPD):
    """A network whose score is the points' mean distance along the approach."""

    def forward(self, points):
        good = torch.sigmoid(100.0 * points[:, :, 0].mean(dim=1))
        return torch.log(torch.stack([1 - good, 0 * good + 1e-9, good], dim=1))


def found(rng):
    _, scene, _ = seen([Can(0.03, 0.12)])
    frame = Frame("f", np.zeros((*scene.depth.shape, 3), np.uint8), scene.depth, CAMERA)
    method = PointNetGPDMethod(FullerIsBetter(PeerNetworkConfig()).eval(), RG2, torch.device("cpu"))
    return scene, method.grasps(frame, scene, rng)


def test_candidates_are_at_the_found_regions():
    _, scene, can = seen([Can(0.03, 0.12), Box((0.3, 0.02, 0.2), (0.0, 0.2, 0.0))])
    known = replace(scene, objects=can.mask)
    (hands, objects), (everywhere, _) = (
        scene_hands(each, np.random.default_rng(0), 2000) for each in (known, scene)
    )
    assert 0 < len(objects) <= len(can)
    assert cKDTree(can.points).query(hands.origin)[0].max() < 0.01
    assert cKDTree(can.points).query(everywhere.origin)[0].max() > 0.1


def test_grasps_open_8_cm_at_points_of_the_object_with_a_score_each():
    scene, (grasps, score) = found(np.random.default_rng(0))
    assert len(grasps) == len(score) > 20
    np.testing.assert_allclose(RG2.opening(grasps.width), 0.08)
    tips = grasps.translation + RG2.tip_reach * grasps.approach
    assert (scene.plane.height(tips) > -0.01).all()
    assert score.max() > score.min()
    assert ((score >= 0) & (score <= 1)).all()


def test_the_same_draws_give_the_same_grasps():
    (_, first), (_, again) = (found(np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(first[1], again[1])
    np.testing.assert_array_equal(first[0].translation, again[0].translation)
