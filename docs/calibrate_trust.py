"""Fit the trust in grounded symmetries: `python docs/calibrate_trust.py ROOT`.

Prints `WEIGHTS` of pipelines/grasping/grounding.py and `BIAS`, `WEIGHTS` of plane_evidence.py:
logistic regressions of truth on evidence, in the regions that the default detector finds on all
frames of ROOT, with the symmetries that the default network names there. ROOT must hold objects
that neither network was trained on, and none of the benchmark's:

    symgrasp synthesize ROOT --splits similar --scenes-per-split 24 --views 4 --objects 48 \
        --size 640x480 --grasp-points 48 --seed 7 --no-collision-labels --workers 2
    symgrasp annotate-symmetry ROOT --workers 2
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.evaluation.judging import assign_regions
from pipelines.evaluation.truth import TruthReader
from pipelines.formats.graspnet import FrameFiles, GraspNetRoot
from pipelines.geometry.symmetry import ReflectionSymmetry, Symmetry
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.grasping import grounding, plane_evidence
from pipelines.grasping.decoding import average_symmetries
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.inference import models
from pipelines.inference.regions import find_regions
from pipelines.metrics.symmetry_matching import TrueRegion, implied_symmetries, scored_symmetries

INFER, EVALUATE = InferConfig(), EvaluateConfig()
MIN_POINTS = 20
# A plane is true at half the error that counts as a hit: a finger needs more than a hit.
PLANE_ERROR, LOOSE_ERROR = 0.134, 0.25
AXIS_ANGLE, AXIS_OFFSET, CENTRE_OFFSET = np.radians(12.0), 0.008, 0.02
RIDGE = 1.0

Rows = list[tuple[list[float], bool]]


def plane_truth(plane: ReflectionSymmetry, region: TrueRegion) -> bool | None:
    """Return whether `plane` is listed; None where it is near one or follows from others."""
    listed = [s for s in scored_symmetries(region, "reflection")]
    near = [s for s in listed if abs(float(plane.normal @ s.direction)) > 0.8]
    error = min((symmetry_error(region.points, plane, s) for s in near), default=np.inf)
    if error <= PLANE_ERROR:
        return True
    follows = implied_symmetries(plane, region.symmetries)
    if any(symmetry_error(region.points, plane, s) <= LOOSE_ERROR for s in follows):
        return None
    return False


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


def frame_rows(reader: TruthReader, files: FrameFiles) -> Iterator[tuple[str, list[float], bool]]:
    """Yield case, evidence and truth of all that may be trusted in one frame."""
    frame, truth = reader.root.read_frame(files), reader.read(files)
    detector = models.detector(models.DETECTOR_WEIGHTS, "cpu")
    predictor = models.predictor(models.NETWORK_WEIGHTS, "cpu")
    found = find_regions(frame, INFER, np.random.default_rng(0), detector)
    scene = SceneCloud(frame.depth.astype(np.float64), frame.intrinsics, found.geometric.plane)
    masks = [region.mask for region in found.regions]
    owners = assign_regions(masks, truth, EVALUATE).instance
    clouds = [RegionCloud.from_mask(mask, scene) for mask in masks]
    large = [i for i, cloud in enumerate(clouds) if len(cloud) >= MIN_POINTS]
    predictions = predictor.predict([clouds[i].points for i in large])
    for i, said in zip(large, predictions, strict=True):
        slots = average_symmetries(said.existence, said.center, said.direction, said.affordance)
        region = truth.regions[owners[i]] if owners[i] >= 0 else TrueRegion(np.zeros((0, 3)), ())
        sampled = clouds[i].at(said.points)
        step = max(1, len(sampled) // grounding.NUM_POINTS)
        seen = sampled.points[::step], sampled.normals[::step]
        axis = grounding.axis_evidence(slots, *seen, scene, INFER.selection)
        sphere = grounding.sphere_evidence(slots, *seen, scene, INFER.selection)
        ball = any(symmetry.kind == "sphere" for symmetry in region.symmetries)
        for each in (axis, sphere):
            if not (ball and each is axis):  # any axis is true of a ball
                row = [1.0, each.existence, each.support, each.consistency]
                yield each.symmetry.kind, row, is_true(each.symmetry, region.symmetries)
        known = grounding.region_evidence(slots, axis, *seen, scene)
        planes = plane_evidence.fitted_planes(known)
        features = plane_evidence.plane_features(planes, known, INFER.selection)
        for plane, row in zip(planes, features.tolist(), strict=True):
            verdict = plane_truth(plane, region)
            if verdict is not None:
                yield "plane", [1.0, *row], verdict


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
    cases: dict[str, Rows] = {}
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
