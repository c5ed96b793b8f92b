"""Train the grasp critic, `pipelines/weights/grasp_critic.safetensors` (D. 82, D. 86).

    python tools/train_grasp_critic.py collect ROOT HANDS.npz [STRIDE [START]]
    python tools/train_grasp_critic.py fit CRITIC.safetensors HELD.npz HANDS.npz ...

`collect` runs `infer`'s own stages with the default weights on every STRIDE-th frame of ROOT, from
START on, and writes how some of the feasible hands at each region look, and their verdict among the
true meshes, opened as they would be if they were chosen (D. 92). `fit` trains the critic on what
was collected of the training's objects, and makes qualities of what it says by HELD, collected of
objects that no network was trained on (tools/calibrate_trust.py says how such a ROOT is made).
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import critic_training
import numpy as np
from calibrate_trust import EVALUATE, INFER, SeenRegion, seen_regions
from critic_training import Rows

from pipelines.dataset.graspnet.graspnet import FrameFiles, GraspNetRoot
from pipelines.evaluation.truth import TruthReader
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.feasibility.opening_margin import with_opening_margin
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.planner import RegionPlanner
from pipelines.grasping.ranking import critic_files
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.inference import models
from pipelines.inference.predicted_regions import PredictedRegion, region_models
from pipelines.metrics.grasp_verdicts import qualities

GRIPPER = load_gripper(INFER.gripper)
ANY = 64  # hands of a region that are judged, of each round of the selection
# The point's and its normal's third coordinate: a hand is its own mirror image.
TRAINING = critic_training.Training(
    mirrored=(2, 6), points_a_step=48, jitter=0.01, rate=3e-3, epochs=8, choice=1.0
)


@dataclass
class Recorder:
    """A critic that expects anything, and remembers what it was asked."""

    rng: np.random.Generator
    asked: list[GraspFeatures] = field(default_factory=list)

    def expect(self, views: GraspFeatures) -> np.ndarray:
        """Return (k,) random numbers below what would keep planar hands away."""
        self.asked.append(views)
        return 0.5 * self.rng.random(len(views.found))


def feasible_hands(
    regions: list[SeenRegion], rng: np.random.Generator
) -> Iterator[tuple[SeenRegion, GraspFeatures, GraspPoses]]:
    """Yield the feasible hands of each region and round, as the critic sees them, and as used."""
    selection, scene = INFER.selection, regions[0].scene
    critic, cap = models.plane_critic(models.PLANE_CRITIC_WEIGHTS), selection.ranking.clearance_cap
    predicted = [PredictedRegion(each.cloud, each.affordance, each.slots) for each in regions]
    for region, model in zip(
        regions, region_models(predicted, scene, selection, critic), strict=True
    ):
        recorder = Recorder(rng)
        RegionPlanner(GRIPPER, selection, recorder).plan(model, scene)
        checks = Feasibility.at(model.cloud, scene, GRIPPER, selection.feasibility, cap)
        checks = checks.with_unseen(model.completion.others).with_unseen(model.completion.own)
        for features in recorder.asked:
            yield region, features, with_opening_margin(features.found, checks, cap).grasps


def judged(views: GraspFeatures, chosen: np.ndarray, quality: np.ndarray) -> Rows:
    """Return how the hands `chosen` (k,) look, and `quality` (k,), theirs among the true meshes."""
    evidence = views.grasp_rows()[chosen]
    return {
        "points": views.point_rows()[chosen],
        "wholes": evidence[:, :0],
        "evidence": evidence,
        "truth": quality.astype(np.float32),
    }


def collected(root: Path, stride: int = 1, start: int = 0) -> Iterator[Rows]:
    """Yield, for each round of each region on an object, how some hands look and turn out."""
    rng = np.random.default_rng(start)
    reader = TruthReader(GraspNetRoot(root), EVALUATE)
    frames = [files for scene in reader.root.scenes() for files in scene.frames()]
    for files in frames[start::stride]:
        yield from of_frame(reader, files, rng)


def of_frame(reader: TruthReader, files: FrameFiles, rng: np.random.Generator) -> Iterator[Rows]:
    """Yield the same of one frame."""
    truth, regions = reader.read(files).scene, list(seen_regions(reader, files))
    if not regions:
        return
    for region, views, hands in feasible_hands(regions, rng):
        if region.object_id >= 0:
            chosen = np.sort(rng.permutation(len(views.found))[:ANY])
            yield judged(views, chosen, qualities(truth, region.object_id, hands[chosen], GRIPPER))


def main() -> None:
    """Collect or fit, as the command line says."""
    command, *arguments = sys.argv[1:]
    if command == "collect":
        root, output, *which = arguments
        rows = collected(Path(root), *(int(number) for number in which))
        with models.one_thread_each():
            count = critic_training.write(Path(output), rows)
        sys.stdout.write(f"{count} hands\n")
    else:
        output, held, *hands = (Path(argument) for argument in arguments)
        critic_training.fit(output, critic_files.GRASPS, held, hands, TRAINING)


if __name__ == "__main__":
    main()
