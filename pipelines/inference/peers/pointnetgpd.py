"""PointNetGPD on a frame: hands at random points of the objects, scored one by one."""

from dataclasses import dataclass

import numpy as np
import torch

from pipelines.array_types import Array, Singles
from pipelines.frames.rgbd import Frame
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.cloud_box import object_points
from pipelines.grasping.peers.darboux import candidate_hands, over_table
from pipelines.grasping.peers.hands import MIN_CLOSED_ON, Hands, drawn_points, hand_grasps, thinned
from pipelines.grasping.scene import SceneCloud
from pipelines.network.peers.pointnetgpd import PointNetGPD

NUM_CANDIDATES = 2000
MOST_SCORED = {"light": 400, "full": 2000}  # collision-free candidates, by variant
FAIR_WEIGHT = 0.5  # of the fair class's probability in the score
AT_ONCE = 64  # candidates


@dataclass(frozen=True)
class PointNetGPDMethod:
    """A trained PointNetGPD; `grasps` is a `FrameMethod`."""

    network: PointNetGPD
    gripper: Gripper
    device: torch.device

    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return grasps, camera frame, and the score of each: P(good) + P(fair) / 2."""
        del frame  # the method needs depth alone
        hands, objects = scene_hands(scene, rng, MOST_SCORED[self.network.config.variant])
        return hand_grasps(hands, self.gripper), self.scores(hands, objects, rng)

    def scores(self, hands: Hands, objects: Array, rng: np.random.Generator) -> Array:
        """Return the score (n,) of each hand; 0 if it closes on too few of `objects` (m, 3)."""
        score, count = np.zeros(len(hands)), self.network.num_points
        clouds = [hands.closing_region(i, objects) for i in range(len(hands))]
        seen = [i for i, cloud in enumerate(clouds) if len(cloud) >= MIN_CLOSED_ON]
        for start in range(0, len(seen), AT_ONCE):
            part = seen[start : start + AT_ONCE]
            score[part] = self._probabilities(
                np.stack([drawn_points(clouds[i], count, rng) for i in part])
            )
        return score

    @torch.inference_mode()
    def _probabilities(self, clouds: Singles) -> Array:
        """Return the scores (k,) of `clouds` (k, n, 3)."""
        probability = self.network(torch.from_numpy(clouds).to(self.device)).exp().cpu().numpy()
        return np.asarray(probability[:, 2] + FAIR_WEIGHT * probability[:, 1], np.float64)


def scene_hands(scene: SceneCloud, rng: np.random.Generator, most: int) -> tuple[Hands, Array]:
    """Return up to `most` candidates of a scene, and the points (m, 3) that may be on objects."""
    points = scene.xyz[scene.near]
    objects = over_table(scene.xyz[object_points(scene)], scene.plane)
    hands = candidate_hands(thinned(objects), thinned(points), NUM_CANDIDATES, rng)
    return hands[np.arange(len(hands))[:most]], objects
