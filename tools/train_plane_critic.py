"""Train the plane critic, `pipelines/weights/plane_critic.safetensors` (D. 80).

    python tools/train_plane_critic.py collect ROOT EVIDENCE.npz [STRIDE]
    python tools/train_plane_critic.py fit CRITIC.safetensors CALIBRATION.npz EVIDENCE.npz ...

`collect` runs the default detector and network on every STRIDE-th frame of ROOT, and writes what
each candidate plane makes of the region, and whether it is true. `fit` trains the critic on what
was collected of the training's objects, and makes log odds of what it says by CALIBRATION,
collected of objects that no network was trained on (tools/calibrate_trust.py says how such a
ROOT is made).
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import critic_training
import numpy as np
from calibrate_trust import EVALUATE, SeenRegion, seen_regions
from critic_training import Rows

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.evaluation.truth import TruthReader
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.grasping.ranking import critic_files
from pipelines.grasping.symmetries import grounding, mirror_views, plane_evidence
from pipelines.grasping.symmetries.plane_evidence import RegionEvidence
from pipelines.inference import models
from pipelines.metrics.symmetry_matching import TrueRegion, implied_symmetries, scored_symmetries

# Dense errors: a hit (Sec. IV), and half of it, since a finger needs more than a hit.
HIT_ERROR, PLANE_ERROR = 0.25, 0.134
ALIKE = 0.8  # cosine of normals, of planes whose error is worth a look
# Of point and normal, the coordinate across; decimetres.
TRAINING = critic_training.Training(
    mirrored=(2, 5), points_a_step=96, jitter=0.01, rate=2e-3, epochs=20
)


def plane_truth(plane: ReflectionSymmetry, region: TrueRegion) -> bool | None:
    """Return whether `plane` is listed; None where it is near one or follows from what is listed.

    Planes near one are hits, but not what a finger needs.
    """
    listed = scored_symmetries(region, "reflection")
    near = [s for s in listed if abs(float(plane.normal @ s.direction)) > ALIKE]
    error = min((symmetry_error(region.points, plane, s) for s in near), default=np.inf)
    if error <= PLANE_ERROR:
        return True
    follows = implied_symmetries(plane, region.symmetries)
    implied = any(symmetry_error(region.points, plane, s) <= HIT_ERROR for s in follows)
    return None if implied or error <= HIT_ERROR else False


def evidence_of(region: SeenRegion) -> RegionEvidence:
    """Return what the planes of a region are judged by."""
    axis, _ = region.axis_and_sphere()
    cloud, step = region.cloud, max(1, len(region.cloud) // grounding.NUM_POINTS)
    seen = cloud.points[::step], cloud.normals[::step], cloud.mask
    return RegionEvidence(region.slots, axis.symmetry, *seen, region.scene)


def collected(root: Path, stride: int) -> Iterator[Rows]:
    """Yield, for each region, what its candidate planes are judged by and their truth."""
    reader = TruthReader(GraspNetRoot(root), EVALUATE)
    frames = [files for scene in reader.root.scenes() for files in scene.frames()]
    for files in frames[::stride]:
        for region in seen_regions(reader, files):
            known = evidence_of(region)
            planes = plane_evidence.fitted_planes(known)
            images = mirror_views.MirrorImages.of(planes, known.points, known.normals)
            verdicts = [plane_truth(plane, region.truth) for plane in planes]
            evidence = plane_evidence.plane_features(planes, images, known)
            yield {
                "points": mirror_views.point_rows(planes, images, known.mask, known.scene),
                "wholes": mirror_views.plane_rows(planes, known.points, known.scene),
                "evidence": evidence.astype(np.float32),
                "truth": np.array(
                    [-1 if verdict is None else int(verdict) for verdict in verdicts]
                ),
            }


def collect(root: Path, output: Path, stride: int) -> None:
    """Write the rows of all regions of `root`."""
    count = critic_training.write(output, collected(root, stride))
    sys.stdout.write(f"{count} planes\n")


def main() -> None:
    """Collect or fit, as the command line says."""
    command, *arguments = sys.argv[1:]
    if command == "collect":
        root, output, *stride = arguments
        with models.one_thread_each():
            collect(Path(root), Path(output), int(stride[0]) if stride else 1)
    else:
        output, calibration, *evidence = (Path(argument) for argument in arguments)
        critic_training.fit(output, critic_files.PLANES, calibration, evidence, TRAINING)


if __name__ == "__main__":
    main()
