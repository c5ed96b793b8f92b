"""Upper bound of PointNetGPD: candidates chosen by true quality, not by the network.

    python -m benchmarks.baseline_oracles ROOT

A low figure means that there is no good candidate; the remaining loss is the network's.
"""

import sys
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.evaluation.frame_scores import owned_by_nearest
from pipelines.evaluation.predictions import ScoredGrasps
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.hands import hand_grasps
from pipelines.grasping.ranking.ranking import non_maximum_suppression
from pipelines.inference.observation import observe
from pipelines.inference.peers.frame_plans import MOST_GRASPS, NMS_ANGLE, NMS_DISTANCE, best_first
from pipelines.inference.peers.pointnetgpd import MOST_SCORED, scene_hands
from pipelines.metrics.grasp_verdicts import qualities


def true_qualities(grasps: GraspPoses, truth: FrameTruth, gripper: Gripper) -> Array:
    """Return (n,) the quality of each grasp at the object with the surface nearest to the grasp."""
    scene, ids = truth.scene, sorted(truth.scene.poses)
    away = [
        scene.objects[i].tree.query(transform_points(invert(scene.poses[i]), grasps.translation))[0]
        for i in ids
    ]
    owner, found = np.array(ids)[np.argmin(away, axis=0)], np.zeros(len(grasps))
    for i in np.unique(owner).tolist():
        found[owner == i] = qualities(scene, i, grasps[owner == i], gripper)
    return found


def best_qualities(root: GraspNetRoot, variant: str) -> dict[str, list[float]]:
    """Return the quality of the best candidate of each visible object, by split."""
    reader, gripper = TruthReader(root, EvaluateConfig()), load_gripper("rg2")
    found: dict[str, list[float]] = {}
    for scene in root.scenes():
        for files in scene.frames():
            rng, truth = np.random.default_rng(0), reader.read(files)
            observation = observe(root.read_frame(files), InferConfig(regions="geometric"), rng)
            hands, _ = scene_hands(observation.scene, rng, MOST_SCORED[variant])
            grasps = hand_grasps(hands, gripper)
            score = true_qualities(grasps, truth, gripper)
            grasps, score = best_first(grasps, score, observation.scene)
            kept = non_maximum_suppression(grasps, NMS_DISTANCE, NMS_ANGLE)[:MOST_GRASPS]
            row = owned_by_nearest(ScoredGrasps(grasps[kept], score[kept]), truth).predictions
            missing = [0.0] * (len(truth.visible) - len(row.rank_score))
            found.setdefault(truth.split, []).extend([*row.rank_score, *missing])
            print(files.name, len(hands), np.mean([*row.rank_score, *missing]).round(3), flush=True)  # noqa: T201
    return found


def main() -> None:
    root = GraspNetRoot.finished(Path(sys.argv[1]))
    for variant in MOST_SCORED:
        found = best_qualities(root, variant)
        for split, values in [
            *found.items(),
            ("all", [v for each in found.values() for v in each]),
        ]:
            print(f"{variant} {split}: {np.mean(values):.3f} of {len(values)} objects")  # noqa: T201


if __name__ == "__main__":
    main()
