"""GraspNet's baseline on a frame: one hand per seed, without colliding hands."""

from dataclasses import dataclass

import numpy as np
import torch

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet_views import GRASP_DEPTHS, view_rotations
from pipelines.frames.rgbd import Frame
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.cloud_box import boxed_points
from pipelines.grasping.peers.hands import Hands, drawn_points, free_hands, hand_grasps, thinned
from pipelines.grasping.scene import SceneCloud
from pipelines.network.peers.graspnet import WIDEST_OPENING, GraspNetBaseline, Operations

WIDER = 1.2  # times the predicted opening, at most the widest
COLLISION_CELL, COLLISION_PATH = 0.01, 0.05  # metres, of the collision test


@dataclass(frozen=True)
class GraspNetMethod:
    """A trained GraspNet baseline; `grasps` is a `FrameMethod`."""

    network: GraspNetBaseline
    gripper: Gripper
    device: torch.device

    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return the collision-free grasps, camera frame, and the predicted score of each.

        The score is the best predicted value at the seed, ln(1 / friction), times the tolerance as
        a share of the widest tolerance.
        """
        del frame  # the method needs depth alone
        cloud = scene.xyz[boxed_points(scene)]
        if not len(cloud):
            return GraspPoses.empty(), np.zeros(0)
        return collision_free_grasps(*self.hands(cloud, rng), cloud, scene, self.gripper)

    @torch.inference_mode()
    def hands(self, cloud: Array, rng: np.random.Generator) -> tuple[Hands, Array]:
        """Return the hands at seeds on objects of `cloud` (n, 3), and their scores."""
        drawn = drawn_points(cloud, self.network.sizes.input, rng)
        points = torch.from_numpy(drawn)[None].to(self.device)
        seeds, _ = self.network.seeds(points)
        view = seeds.views[0].argmax(dim=1).cpu().numpy()
        frames = view_rotations()[view]
        untwisted = torch.from_numpy(frames[:, 0])[None].to(self.device)
        predicted = self.network.operations(points, seeds.points, untwisted)
        hands, score = best_hands(seeds.points[0].cpu().numpy(), frames, predicted)
        on_object = (seeds.objectness[0].argmax(dim=1) == 1).cpu().numpy()
        return hands[on_object], score[on_object]


def best_hands(seeds: Array, frames: Array, predicted: Operations) -> tuple[Hands, Array]:
    """Return the best hand at each of S seeds, and its score.

    `seeds`: (S, 3) metres; `frames`: (S, 12, 3, 3) rotations of hands along the seed's view;
    `predicted`: for one cloud.
    """
    best = predicted.angle[0].argmax(dim=2, keepdim=True)  # (S, 4, 1) angles
    at_angle = (predicted.score, predicted.width, predicted.tolerance)
    at_depths = [best[..., 0], *(each[0].gather(2, best)[..., 0] for each in at_angle)]
    depth = at_depths[1].argmax(dim=1, keepdim=True)
    rows = [each.gather(1, depth)[:, 0].cpu().numpy() for each in at_depths]
    angle, score, width, tolerance = rows
    opening = np.clip(WIDER * WIDEST_OPENING * np.clip(width, 0.0, 1.0), 0.0, WIDEST_OPENING)
    hands = Hands(
        frames[np.arange(len(seeds)), angle].astype(np.float64),
        seeds.astype(np.float64),
        GRASP_DEPTHS[depth[:, 0].cpu().numpy()],
        opening.astype(np.float64),
    )
    return hands, np.asarray(score * tolerance, np.float64)


def collision_free_grasps(
    hands: Hands, score: Array, cloud: Array, scene: SceneCloud, gripper: Gripper
) -> tuple[GraspPoses, Array]:
    """Return the `hands` that collide with no point as grasps, and their scores.

    `cloud`: (n, 3) metres, points in the box of the scene; all other seen points count too.
    """
    clouds = thinned(cloud, COLLISION_CELL), thinned(scene.xyz[scene.near], COLLISION_CELL)
    free = free_hands(hands, *clouds, size=COLLISION_CELL, approach_path=COLLISION_PATH)
    return hand_grasps(hands[free], gripper), score[free]
