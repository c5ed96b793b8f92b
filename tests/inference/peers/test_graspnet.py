"""GraspNet's baseline on a frame, with a stand-in for the network."""

from dataclasses import replace

import numpy as np
import torch

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.dataset.graspnet.graspnet_views import generate_views
from pipelines.frames.rgbd import Frame
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.peers.cloud_box import boxed_points
from pipelines.inference.peers.graspnet import GraspNetMethod
from pipelines.network.peers.graspnet import GraspNetBaseline, Operations, Seeds
from tests.geometry.tabletops import CAMERA, Box, Can
from tests.grasping.seen_regions import seen

RG2 = load_gripper("rg2")
TOWARD_CAMERA = int(generate_views()[:, 2].argmin())


class AlwaysTheSame(GraspNetBaseline):
    """Approaches along the camera's axis at angle 3, depth 2; every other seed is on the table."""

    def seeds(self, points):
        index = torch.arange(64)[None]
        objectness = torch.zeros(1, 64, 2)
        objectness[0, ::2, 0] = objectness[0, 1::2, 1] = 1.0
        views = torch.zeros(1, 64, 300)
        views[..., TOWARD_CAMERA] = 1.0
        return Seeds(points[:, :64], index, objectness, views), points

    def operations(self, points, origin, rotation):
        score, angle = torch.zeros(1, 64, 4, 12), torch.zeros(1, 64, 4, 12)
        score[..., 2, :], angle[..., 3] = 0.8, 1.0
        return Operations(score, angle, torch.full_like(score, 0.5), torch.full_like(score, 0.5))


def method():
    network = AlwaysTheSame(PeerNetworkConfig()).eval()
    return GraspNetMethod(network, RG2, torch.device("cpu"))


def test_seeds_on_objects_become_hands_with_the_best_angle_and_depth():
    cloud = np.random.default_rng(0).uniform([0, 0, 0.6], [0.1, 0.1, 0.7], (500, 3))
    hands, score = method().hands(cloud, np.random.default_rng(0))
    assert len(hands) == 32
    np.testing.assert_allclose(hands.depth, 0.03)
    np.testing.assert_allclose(hands.opening, 1.2 * 0.05)
    np.testing.assert_allclose(score, 0.8 * 0.5)
    np.testing.assert_allclose(hands.rotation[:, 2, 0], -generate_views()[TOWARD_CAMERA, 2])


def test_hands_that_meet_the_cloud_are_dropped():
    _, scene, _ = seen([Can(0.03, 0.12)])
    frame = Frame("f", np.zeros((*scene.depth.shape, 3), np.uint8), scene.depth, CAMERA)
    grasps, score = method().grasps(frame, scene, np.random.default_rng(0))
    assert len(grasps) == len(score) < 32


def test_the_cloud_is_a_box_around_the_objects_on_the_table():
    pose, scene, _ = seen([Can(0.03, 0.12)])
    boxed = scene.xyz[boxed_points(scene)]
    local = (boxed - pose[:3, 3]) @ pose[:3, :3]
    assert np.abs(local[:, :2]).max() < 0.06
    assert -0.03 < local[:, 2].min() < 0.01
    assert local[:, 2].max() > 0.11


def test_a_wall_is_outside_of_the_box_if_the_regions_are_known():
    pose, scene, can = seen([Can(0.03, 0.12), Box((0.3, 0.02, 0.2), (0.0, 0.2, 0.0))])
    reach = [
        np.abs(((each.xyz[boxed_points(each)] - pose[:3, 3]) @ pose[:3, :3])[:, 1]).max()
        for each in (scene, replace(scene, objects=can.mask))
    ]
    assert reach[0] > 0.18
    assert reach[1] < 0.06
