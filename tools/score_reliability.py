"""Reliability of `rank_score`: `python tools/score_reliability.py GRASPS ROOT [STRIDE] [FRICTION]`.

GRASPS is an output of `symgrasp infer` for ROOT, a dataset with convex pieces (`symgrasp
synthesize` makes them). In every STRIDE-th frame (1), the best grasp of each region on an object
and one other, drawn at random, are simulated as `symgrasp simulate` does with the best, at FRICTION
(0.5). Prints a table with scores in ten bins, the success rate of each bin and its interval; then
the excess of the mean score over the success rate, with its interval over scenes.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.configs import EvaluateConfig, SimulateConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError, ValueRangeError, counted, errors_as_sentences
from pipelines.evaluation.frame_scores import assign_regions
from pipelines.evaluation.predictions import FramePredictions
from pipelines.evaluation.runs.trial_records import HELD
from pipelines.evaluation.truth import TruthReader
from pipelines.grasp_files.grasps_stream import read_dataset_frames, read_index
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.metrics.success_rate import success_rate
from pipelines.simulation.frames import PiecesReader
from pipelines.simulation.trial import Trial
from pipelines.simulation.world import at_rest

BINS = 10
DRAWS = 1000  # draws of the bootstrap over scenes
NO_CACHE = Path("no-cache")  # the dataset has its convex pieces


@dataclass(frozen=True)
class TriedGrasp:
    """The scene of a grasp, its score and whether it succeeded."""

    scene: int
    score: float
    held: bool


def chosen_rows(table: GraspTable, owners: list[int], rng: np.random.Generator) -> list[int]:
    """Return the best grasp and a random other of each region on an object."""
    rows: list[int] = []
    for region in np.unique(table.region).tolist():
        if owners[region] < 0:
            continue
        mine = np.flatnonzero(table.region == region)
        mine = mine[np.argsort(table.rank_in_frame[mine])]
        rows += [int(mine[0]), *rng.permutation(mine[1:])[:1].tolist()]
    return rows


def tried_grasps(
    result: FrameResult, root: GraspNetRoot, gripper: Gripper, friction: float
) -> Iterator[TriedGrasp]:
    """Yield the outcomes of the chosen grasps of a frame in its true scene."""
    rules, config = EvaluateConfig(), SimulateConfig()
    files = root.frame(result.name)
    truth = TruthReader(root, rules).read(files)
    masks = FramePredictions.from_result(result).masks
    owners = assign_regions(masks, truth, rules).object_id
    pieces, T_table_cam = PiecesReader(root, NO_CACHE), truth.scene.T_table_cam
    objects = {i: pieces.read(i) for i in truth.scene.poses}
    given = {i: T_table_cam @ pose for i, pose in truth.scene.poses.items()}
    around = [each.mesh for each in truth.scene.surroundings]
    poses = at_rest(objects, given, around)
    table = result.grasps
    for row in chosen_rows(table, owners, np.random.default_rng(0)):
        grasp = GraspPoses(table.rotation[row], table.translation[row], table.width[row])
        target, placed = owners[int(table.region[row])], grasp.transformed(T_table_cam)
        trial = Trial.of(objects, poses, target, placed, gripper, config, around)
        held = trial.run(friction).reason == HELD
        yield TriedGrasp(files.scene_id, float(table.rank_score[row]), held)


def reliability_rows(tried: list[TriedGrasp]) -> list[str]:
    """Return the lines of a table: bin of scores, trials, mean score, success and interval."""
    lines = ["| score | trials | mean score | success | 95 % interval |", "|---|---|---|---|---|"]
    scores, held = (np.array([getattr(t, name) for t in tried]) for name in ("score", "held"))
    places = np.minimum((scores * BINS).astype(int), BINS - 1)
    for place in range(BINS):
        mine = places == place
        if not mine.any():
            continue
        rate = success_rate(int(mine.sum()), int(held[mine].sum()))
        low, high = rate["low"], rate["high"]
        bounds = f"{place / BINS:.1f}-{(place + 1) / BINS:.1f}"
        cells = bounds, mine.sum(), f"{scores[mine].mean():.2f}", f"{rate['rate']:.2f}"
        lines.append(f"| {' | '.join(map(str, cells))} | {low:.2f}-{high:.2f} |")
    return lines


def excess(tried: list[TriedGrasp]) -> tuple[float, float, float]:
    """Return the excess of the mean score over the success, and its 95 % interval over scenes."""
    by_scene: dict[int, list[float]] = {}
    for each in tried:
        by_scene.setdefault(each.scene, []).append(each.score - each.held)
    sums = np.array([(sum(values), len(values)) for values in by_scene.values()])
    rng = np.random.default_rng(0)
    drawn = sums[rng.integers(0, len(sums), (DRAWS, len(sums)))].sum(axis=1)
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
    total = sums.sum(axis=0)
    return float(total[0] / total[1]), float(low), float(high)


def main(grasps: Path, root: GraspNetRoot, stride: int, friction: float) -> None:
    """Print the table of a file's grasps.

    Raises:
        ValueRangeError: `stride` is not positive.
        SymgraspError: no grasp is on an object.
    """
    if stride < 1:
        raise ValueRangeError("STRIDE", stride, "at least 1")
    index = read_index(grasps)
    gripper, tried = load_gripper(index.gripper), []
    for result in read_dataset_frames(grasps, range(0, len(index.names), stride)):
        tried += list(tried_grasps(result, root, gripper, friction))
        sys.stderr.write(f"{result.name}: {counted(len(tried), 'grasp')} tried\n")
    if not tried:
        raise SymgraspError(f"{grasps} has no grasp on an object of {root.root}; give other grasps")
    sys.stdout.write("\n".join(reliability_rows(tried)) + "\n")
    more, low, high = excess(tried)
    held = np.mean([each.held for each in tried])
    expected = np.mean([each.score for each in tried])
    sys.stdout.write(
        f"{gripper.name}, friction {friction:g}: {counted(len(tried), 'grasp')}, "
        f"mean score {expected:.3f}, success {held:.3f}, "
        f"more by {more:.3f} ({low:.3f} to {high:.3f})\n"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("grasps", type=Path)
    parser.add_argument("root", type=lambda text: GraspNetRoot(Path(text)))
    parser.add_argument("stride", type=int, nargs="?", default=1)
    parser.add_argument("friction", type=float, nargs="?", default=0.5)
    with errors_as_sentences():
        main(**vars(parser.parse_args()))
