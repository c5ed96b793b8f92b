"""Fit the trust in grounded symmetries: `python tools/calibrate_trust.py ROOT`.

Prints `WEIGHTS` of pipelines/grasping/grounding.py: logistic regressions of truth on evidence, in
the regions that the default detector finds on all frames of ROOT, with the axes and centres that
the default network names there. ROOT must hold objects that neither network was trained on, and
none of the benchmark's:

    symgrasp synthesize ROOT --split similar --scenes-per-split 24 --views 4 --objects 48 \
        --size 640x480 --grasp-points 48 --seed 7 --no-collision-labels --workers 2
    symgrasp annotate-symmetry ROOT --workers 2
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.dataset.graspnet.graspnet import FrameFiles, GraspNetRoot
from pipelines.evaluation.frame_scores import assign_regions
from pipelines.evaluation.truth import TruthReader
from pipelines.geometry.symmetry import (
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
    SymmetrySlots,
)
from pipelines.grasping.planner import MIN_POINTS
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries import grounding
from pipelines.inference import models
from pipelines.inference.observation import observe
from pipelines.inference.predicted_regions import predicted_regions
from pipelines.metrics.symmetry_matching import TrueRegion

INFER, EVALUATE = InferConfig(), EvaluateConfig()
AXIS_ANGLE, AXIS_OFFSET, CENTRE_OFFSET = np.radians(12.0), 0.008, 0.02
RIDGE = 1.0

LabelledRows = list[tuple[list[float], bool]]


def is_true(found: Symmetry, truths: tuple[Symmetry, ...]) -> bool:
    """Return whether the axis or centre `found` is one of `truths`."""
    return any(_matches(found, truth) for truth in truths if getattr(truth, "order", None) is None)


def _matches(found: Symmetry, truth: Symmetry) -> bool:
    if truth.kind != found.kind:
        return False
    apart = found.point - truth.point
    if found.kind == "sphere":
        return float(np.linalg.norm(apart)) < CENTRE_OFFSET
    cosine = abs(float(found.direction @ truth.direction))
    off = float(np.linalg.norm(np.cross(apart, truth.direction)))
    return cosine > np.cos(AXIS_ANGLE) and off < AXIS_OFFSET


@dataclass(frozen=True)
class SeenRegion:
    """A region that the detector finds: what the network says of it, what is seen, the truth.

    `object_id` is the object's that it lies on, -1 for none.
    """

    slots: SymmetrySlots
    affordance: np.ndarray
    object_id: int
    cloud: RegionCloud
    scene: SceneCloud
    truth: TrueRegion

    def axis_and_sphere(
        self,
    ) -> tuple[grounding.Evidence[RotationSymmetry], grounding.Evidence[SphereSymmetry]]:
        """Return the fitted axis and centre."""
        step = max(1, len(self.cloud) // grounding.NUM_POINTS)
        seen = self.cloud.points[::step], self.cloud.normals[::step]
        axis = grounding.axis_evidence(self.slots, *seen, self.scene)
        return axis, grounding.sphere_evidence(self.slots, *seen, self.scene)


def seen_regions(reader: TruthReader, files: FrameFiles) -> Iterator[SeenRegion]:
    """Yield the regions of one frame that are large enough."""
    frame, truth = reader.root.read_frame(files), reader.read(files)
    detector = models.detector(models.DETECTOR_WEIGHTS, "cpu")
    predictor = models.predictor(models.NETWORK_WEIGHTS, "cpu")
    seen = observe(frame, INFER, np.random.default_rng(0), detector=detector)
    owners = assign_regions([region.mask for region in seen.regions], truth, EVALUATE)
    large = [i for i, cloud in enumerate(seen.clouds) if len(cloud) >= MIN_POINTS]
    predicted = predicted_regions([seen.clouds[i] for i in large], seen.scene.plane, predictor)
    for i, each in zip(large, predicted, strict=True):
        owner, seen_by = owners.instance[i], (each.cloud, seen.scene)
        region = truth.regions[owner] if owner >= 0 else TrueRegion(np.zeros((0, 3)), ())
        yield SeenRegion(each.slots, each.affordance, owners.object_id[i], *seen_by, region)


def frame_rows(reader: TruthReader, files: FrameFiles) -> Iterator[tuple[str, list[float], bool]]:
    """Yield case, evidence and truth of the axes and centres of one frame."""
    for region in seen_regions(reader, files):
        ball = any(symmetry.kind == "sphere" for symmetry in region.truth.symmetries)
        axis, sphere = region.axis_and_sphere()
        for each in (axis, sphere):
            if not (ball and each is axis):  # any axis is true of a ball
                row = [1.0, each.existence, each.support, each.consistency]
                yield each.symmetry.kind, row, is_true(each.symmetry, region.truth.symmetries)


def logistic(features: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the ridge logistic regression's weights (f,), the first column a constant."""
    scale = np.maximum(features.std(axis=0), 1e-9)
    scale[0] = 1.0
    centre = np.where(np.arange(len(scale)) == 0, 0.0, features.mean(axis=0))
    rows, ridge = (features - centre) / scale, np.where(np.arange(len(scale)) == 0, 0.0, RIDGE)
    weights = np.zeros(len(scale))
    for _ in range(50):  # Newton's method
        share = 1.0 / (1.0 + np.exp(-rows @ weights))
        curvature = (rows * (share * (1 - share))[:, None]).T @ rows + np.diag(ridge)
        slope = rows.T @ (truth - share) - ridge * weights
        weights = weights + np.linalg.solve(curvature, slope)
    weights = weights / scale
    weights[0] -= weights[1:] @ centre[1:]
    return weights


def main() -> None:
    """Collect evidence and print one line a case."""
    reader = TruthReader(GraspNetRoot(Path(sys.argv[1])), EVALUATE)
    cases: dict[str, LabelledRows] = {}
    with models.one_thread_each():
        for scene in reader.root.scenes():
            for files in scene.frames():
                for case, row, right in frame_rows(reader, files):
                    cases.setdefault(case, []).append((row, right))
    for case, found in sorted(cases.items()):
        features = np.array([row for row, _ in found])
        truth = np.array([right for _, right in found], float)
        weights = logistic(features, truth).round(2).tolist()
        sys.stdout.write(f"{case}: {weights}, {len(found)} candidates, {truth.mean():.2f} true\n")


if __name__ == "__main__":
    main()
