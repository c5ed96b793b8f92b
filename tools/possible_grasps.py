"""Find the objects of a report that any grasp holds: `python tools/possible_grasps.py REPORT ROOT`.

REPORT is an output of `symgrasp evaluate` for grasps on ROOT. Antipodal pairs are drawn on the true
meshes; each is tried at evenly spaced angles among the true objects and above the table, with the
verdict of `evaluate`. A failed search is strong evidence but no proof: pairs are a sample. Prints
each object that was not held, and per split the number of objects that some grasp holds.
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import EvaluateConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import FormatError, MissingInputError, counted, errors_as_sentences
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.records import FrameRecord, read_frame_records, records_folder
from pipelines.evaluation.truth import TruthReader
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.rendering import first_hits
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.metrics.grasp_verdicts import TrueScene, qualities
from pipelines.storage.provenance import read_stamp

POINTS = 12_000  # points of a surface, each with its opposite point
PAIRS = 600
ANGLES = 24
AT_ONCE = 50  # pairs between checks for a grasp of quality 1
MIN_COSINE = 0.7  # of the far normal with the contact line: holds at friction 1, the largest value
INSIDE = 1e-5  # metres below the surface at which a ray starts


@dataclass
class Tally:
    """Counts of one split, an entry per visible object."""

    held: list[bool] = field(default_factory=list)
    best: list[float] = field(default_factory=list)  # quality, 0 to 1, of the best grasp found


def antipodal_pairs(mesh: Mesh, gripper: Gripper, rng: np.random.Generator) -> Array:
    """Return (n, 2, 3) up to `PAIRS` opposite points of `mesh`, within the gripper's width."""
    points, normals, _ = sample_surface(mesh, POINTS, rng)
    distance, triangle = first_hits(mesh, points - INSIDE * normals, -normals)
    met = np.isfinite(distance)
    width = np.where(met, distance, 0.0) + INSIDE
    cosine = np.einsum("ni,ni->n", mesh.face_normals[triangle], -normals)
    fits = met & (cosine > MIN_COSINE) & (width > 10 * INSIDE) & (width <= gripper.max_width)
    kept = rng.permutation(np.flatnonzero(fits))[:PAIRS]
    far = points[kept] - width[kept, None] * normals[kept]
    return np.stack([points[kept], far], 1)


def best_quality(scene: TrueScene, object_id: int, gripper: Gripper) -> float:
    """Return the quality of the best grasp found at an object, 0 if none holds; camera frame."""
    rng = np.random.default_rng(object_id)
    pairs = antipodal_pairs(scene.objects[object_id].mesh, gripper, rng)
    best = 0.0
    for start in range(0, len(pairs), AT_ONCE):
        some = pairs[start : start + AT_ONCE]
        upright = GraspPoses.from_contacts(some, np.broadcast_to([0.0, 0.0, 1.0], (len(some), 3)))
        pair, angle = np.divmod(np.arange(len(some) * ANGLES), ANGLES)
        grasps = upright.at_approach_angles(pair, angle * (2 * np.pi / ANGLES))
        found = qualities(scene, object_id, grasps.transformed(scene.poses[object_id]), gripper)
        best = max(best, float(found.max()))
        if best >= 1.0:
            break
    return best


def record_frames(report: Path) -> Iterator[FrameRecord]:
    """Yield the frames that `report` scored.

    Raises:
        MissingInputError: there are no records.
    """
    files = sorted(records_folder(report).glob("*.json"))
    if not files:
        raise MissingInputError(records_folder(report) / "*.json", "symgrasp evaluate")
    for path in files:
        yield from read_frame_records(path)


def main(report: Path, root: GraspNetRoot) -> None:
    """Print the objects that were not held, and counts of possible grasps.

    Raises:
        FormatError: `report` is no report.
    """
    stamp = read_stamp(report) or {}
    if stamp.get("stage") != "evaluate":
        raise FormatError(
            report, "is no report", "a report.json of `symgrasp evaluate` is expected"
        )
    gripper = load_gripper(stamp["config"]["gripper"])
    truths = TruthReader(root, EvaluateConfig())
    tallies: dict[str, Tally] = defaultdict(Tally)
    for frame in record_frames(report):
        scene = truths.read(root.frame(frame.name)).scene
        for verdict in frame.rows[OURS].verdicts:
            best = best_quality(scene, verdict.object_id, gripper)
            held = verdict.reason == "held"
            tallies[frame.split].held.append(held)
            tallies[frame.split].best.append(max(best, verdict.quality))
            if not held:
                label = f"{frame.name} object {verdict.object_id:03d}: {verdict.reason}"
                sys.stdout.write(f"{label}, the best grasp found {best:.2f}\n")
    for split, tally in tallies.items():
        is_held, quality = np.array(tally.held), np.array(tally.best)
        more, none = (~is_held & (quality > 0)).sum(), (quality == 0).sum()
        sys.stdout.write(
            f"{split}: {counted(len(is_held), 'object')}, {is_held.sum()} held, "
            f"{more} more could be, {none} by no grasp found; best quality {quality.mean():.3f}\n"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("report", type=Path)
    parser.add_argument("root", type=lambda text: GraspNetRoot(Path(text)))
    with errors_as_sentences():
        main(**vars(parser.parse_args()))
