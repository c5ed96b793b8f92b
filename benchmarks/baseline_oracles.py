"""Upper bound of PointNetGPD: candidates chosen by true quality, not by the network.

    python -m benchmarks.baseline_oracles ROOT

A low figure means that there is no good candidate; the remaining loss is the network's.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import errors_as_sentences
from pipelines.evaluation.frame_scores import owned_by_nearest
from pipelines.evaluation.predictions import ScoredGrasps
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.hands import hand_grasps
from pipelines.inference.observation import observe
from pipelines.inference.peers.frame_plans import best_distinct, best_first, scene_with_objects
from pipelines.inference.peers.pointnetgpd import MOST_SCORED, scene_hands
from pipelines.metrics.grasp_verdicts import qualities


def true_qualities(grasps: GraspPoses, truth: FrameTruth, gripper: Gripper) -> Array:
    """Return (n,) the quality of each grasp at the object with the surface nearest to the grasp."""
    owner, found = truth.scene.nearest_object(grasps.translation), np.zeros(len(grasps))
    for i in np.unique(owner).tolist():
        found[owner == i] = qualities(truth.scene, i, grasps[owner == i], gripper)
    return found


def best_qualities(root: GraspNetRoot, variant: str) -> dict[str, list[float]]:
    """Return the quality of the best candidate of each visible object, by split."""
    reader, gripper = TruthReader(root, EvaluateConfig()), load_gripper("rg2")
    found: dict[str, list[float]] = {}
    for scene in root.scenes():
        for files in scene.frames():
            rng, truth = np.random.default_rng(0), reader.read(files)
            observation = observe(root.read_frame(files), InferConfig(regions="geometric"), rng)
            hands, _ = scene_hands(scene_with_objects(observation), rng, MOST_SCORED[variant])
            grasps = hand_grasps(hands, gripper)
            score = true_qualities(grasps, truth, gripper)
            grasps, score = best_first(grasps, score, observation.scene)
            kept = best_distinct(grasps)
            row = owned_by_nearest(ScoredGrasps(grasps[kept], score[kept]), truth).predictions
            best = [max(quality, 0.0) for quality in row.rank_score]  # -inf without a grasp
            found.setdefault(truth.split, []).extend(best)
            sys.stderr.write(f"{files.name}: {len(hands)} hands, quality {np.mean(best):.3f}\n")
    return found


@errors_as_sentences()
def main(arguments: Sequence[str] | None = None) -> None:
    """Print the mean quality of each variant by split."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.baseline_oracles")
    parser.add_argument("root", type=Path, help="dataset in GraspNet-1Billion's layout")
    root = GraspNetRoot.finished(parser.parse_args(arguments).root)
    for variant in MOST_SCORED:
        found = best_qualities(root, variant)
        found["all"] = [quality for split in found.values() for quality in split]
        for split, values in found.items():
            mean = np.mean(values)
            sys.stdout.write(f"{variant} {split}: {mean:.3f} of {len(values)} objects\n")


if __name__ == "__main__":
    main()
