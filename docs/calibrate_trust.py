"""Fit the trust in grounded symmetries: `python docs/calibrate_trust.py ROOT PACKED NETWORK`.

Prints `WEIGHTS` of pipelines/grasping/grounding.py: for each case a logistic regression of truth on
(1, existence, support, consistency), over the scenes of ROOT that `train` held out of PACKED.
Their objects are trained ones: trust is calibrated for the seen pool and its synthetic noise.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipelines.configs import SelectionConfig, TrainConfig
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.graspnet_layout import FrameFiles, SceneFiles
from pipelines.formats.packed_regions import PackedReader
from pipelines.formats.regioned_objects import read_regioned_object
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.region_masks import visible_regions
from pipelines.geometry.symmetry import Symmetry
from pipelines.grasping import grounding
from pipelines.grasping.decoding import average_symmetries
from pipelines.grasping.grounding import Evidence
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.learning.loaders import split_by_scene
from pipelines.network.predictor import GraspPredictor

SELECTION = SelectionConfig()
MIN_PIXELS, MIN_POINTS = 400, 200
ANGLE, PLANE_OFFSET, AXIS_OFFSET, CENTRE_OFFSET = np.radians(10.0), 0.007, 0.008, 0.02
AXIS_ANGLE = np.radians(12.0)
MOOT_ON_BALLS = ("hidden", "level", "rotation")  # any such symmetry is true of a ball
RIDGE = np.array([1e-3, 0.3, 0.3, 0.3])


def held_out_scenes(packed: Path) -> set[int]:
    """Return the numbers of the scenes that `train` with seed 0 validates on."""
    reader = PackedReader(packed)
    rng = np.random.default_rng(0)
    _, held_out = split_by_scene(reader, TrainConfig.val_fraction, rng)
    stems = {reader.paths[reader.locate(int(i))[0]].stem for i in held_out}
    return {int(stem.split("_")[1]) for stem in stems}


def is_true(found: Symmetry, truths: list[Symmetry]) -> bool:
    """Return whether `found` is one of `truths`, or follows from one."""
    return any(_matches(found, truth) for truth in truths if getattr(truth, "order", None) is None)


def _matches(found: Symmetry, truth: Symmetry) -> bool:
    apart = found.point - truth.point
    if found.kind == "sphere":
        return truth.kind == "sphere" and float(np.linalg.norm(apart)) < CENTRE_OFFSET
    cosine = abs(float(found.direction @ truth.direction))
    if found.kind == "rotation":
        off = float(np.linalg.norm(np.cross(apart, truth.direction)))
        return truth.kind == "rotation" and cosine > np.cos(AXIS_ANGLE) and off < AXIS_OFFSET
    near = abs(float(apart @ found.direction)) < PLANE_OFFSET
    match truth.kind:
        case "reflection":
            return near and cosine > np.cos(ANGLE)
        case "rotation":  # a plane through the axis
            return near and cosine < np.sin(ANGLE)
        case _:  # a plane through a sphere's centre
            return near


def frame_evidence(
    root: GraspNetRoot, scene: SceneFiles, files: FrameFiles, predictor: GraspPredictor
) -> Iterator[tuple[Evidence, bool]]:
    """Yield all evidence of one frame's true regions, and whether it is right."""
    frame = root.read_frame(files)
    poses = [(pose.object_id, pose.T_cam_obj) for pose in root.read_annotation(files)]
    objects = {number: read_regioned_object(root.root, number) for number, _ in poses}
    T_table_cam = scene.table_from_camera(files.frame_id)
    table = Plane(T_table_cam[2, :3], float(T_table_cam[2, 3]))
    cloud = SceneCloud(frame.depth.astype(np.float64), frame.intrinsics, table)
    shown = visible_regions(root.read_label(files), frame.intrinsics, poses, objects)
    pairs = [(r, RegionCloud.from_mask(r.mask, cloud)) for r in shown if r.mask.sum() > MIN_PIXELS]
    pairs = [(region, seen) for region, seen in pairs if len(seen) > MIN_POINTS]
    predictions = predictor.predict([seen.points for _, seen in pairs])
    for (region, seen), said in zip(pairs, predictions, strict=True):
        slots = average_symmetries(said.existence, said.center, said.direction, said.affordance)
        sampled = seen.at(said.points)
        step = max(1, len(sampled) // grounding.NUM_POINTS)
        around = sampled.points[::step], sampled.normals[::step], cloud, SELECTION
        evidence = [*grounding.plane_evidence(slots, *around)]
        evidence.append(grounding.axis_evidence(slots, *around))
        evidence.append(grounding.sphere_evidence(slots, *around))
        ball = any(symmetry.kind == "sphere" for symmetry in region.symmetries)
        for each in evidence:
            if not (ball and each.case in MOOT_ON_BALLS):
                yield each, is_true(each.symmetry, list(region.symmetries))


def logistic(features: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the ridge logistic regression's weights (4,) by Newton's method."""
    weights = np.zeros(4)
    for _ in range(50):
        share = 1.0 / (1.0 + np.exp(-features @ weights))
        curvature = (features * (share * (1 - share))[:, None]).T @ features + np.diag(RIDGE)
        slope = features.T @ (truth - share) - RIDGE * weights
        weights = weights + np.linalg.solve(curvature, slope)
    return weights


def main() -> None:
    """Collect evidence and print one line a case."""
    root, packed, network = GraspNetRoot(Path(sys.argv[1])), Path(sys.argv[2]), Path(sys.argv[3])
    predictor, wanted = GraspPredictor.load(network, "cpu"), held_out_scenes(packed)
    rows: dict[str, list[tuple[float, float, float, float, bool]]] = {}
    for scene in root.scenes():
        if scene.scene_id not in wanted:
            continue
        for files in scene.frames():
            for e, right in frame_evidence(root, scene, files, predictor):
                row = (1.0, e.existence, e.support, e.consistency, right)
                rows.setdefault(e.case, []).append(row)
    for case, found in sorted(rows.items()):
        table = np.array(found, float)
        weights = logistic(table[:, :4], table[:, 4])
        sys.stdout.write(f"{case}: {weights.round(1).tolist()}, {len(table)} candidates, ")
        sys.stdout.write(f"{table[:, 4].mean():.2f} true\n")


if __name__ == "__main__":
    main()
