"""The trials of a frame: the same grasps that `evaluate` judges, tried in the true scene."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipelines.configs import EvaluateConfig, SimulateConfig
from pipelines.evaluation.judging import assign_regions, best_region
from pipelines.evaluation.predictions import FramePredictions, Mask
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.formats import convex_pieces
from pipelines.formats.coco_instances import kind_of
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.grasps_file import FrameResult
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.simulation.records import FrameTrials, TrialRecord, friction_key
from pipelines.simulation.trial import Outcome, Trial
from pipelines.simulation.world import Array, Pieces, at_rest


@dataclass
class PiecesReader:
    """Reads the convex pieces of models: the dataset's own, or those of `cache`."""

    root: GraspNetRoot
    cache: Path
    _pieces: dict[int, Pieces] = field(default_factory=dict)

    def source(self, object_id: int) -> Path:
        """Return the dataset's file that the pieces come from: the pieces, or else the mesh."""
        mesh = self.root.model_path(object_id)
        pieces = mesh.with_name("convex.npz")
        return pieces if pieces.is_file() else mesh

    def path(self, object_id: int) -> Path:
        """Return where the pieces of an object are, or are to be."""
        source = self.source(object_id)
        return source if source.suffix == ".npz" else self.cache / f"{object_id:03d}.npz"

    def read(self, object_id: int) -> Pieces:
        """Return the pieces of an object, object frame."""
        if object_id not in self._pieces:
            self._pieces[object_id] = convex_pieces.read(self.path(object_id))
        return self._pieces[object_id]


@dataclass
class FrameSimulator:
    """Tries the grasps of frames; what it reads of objects is kept."""

    root: GraspNetRoot
    pieces: PiecesReader
    gripper: Gripper
    config: SimulateConfig

    def __post_init__(self) -> None:
        self._rules = EvaluateConfig(
            min_visible_pixels=self.config.min_visible_pixels,
            min_region_share=self.config.min_region_share,
        )
        self._reader = TruthReader(self.root, self._rules)

    def run(self, result: FrameResult) -> FrameTrials:
        """Return what becomes of the best grasp on every visible object of a frame."""
        truth = self._reader.read(self.root.frame(result.name))
        predictions = FramePredictions.from_result(result)
        owners = assign_regions(predictions.masks, truth, self._rules)
        T_table_cam = truth.scene.T_table_cam
        given = {i: T_table_cam @ pose for i, pose in truth.scene.poses.items()}
        objects = {i: self.pieces.read(i) for i in given}
        poses = at_rest(objects, given)
        shift = max(np.linalg.norm(poses[i][:3, 3] - given[i][:3, 3]) for i in given)
        trials = []
        for object_id in truth.visible:
            region = best_region(object_id, predictions.row, owners)
            grasp = Grasps.empty() if region is None else predictions.row.best[region]
            mask = None if region is None else predictions.masks[region]
            outcomes = self._try(objects, poses, object_id, grasp.transformed(T_table_cam))
            trials.append(TrialRecord(object_id, kind_at(truth, object_id, mask), outcomes))
        return FrameTrials(result.name, truth.split, float(shift), trials)

    def _try(
        self,
        objects: dict[int, Pieces],
        poses: dict[int, Array],
        object_id: int,
        grasp: Grasps,
    ) -> dict[str, Outcome]:
        """Return the outcomes by friction; `grasp`, table frame, may be none."""
        if not len(grasp):
            return {friction_key(mu): Outcome("no grasp") for mu in self.config.frictions}
        trial = Trial.of(objects, poses, object_id, grasp, self.gripper, self.config)
        return {friction_key(mu): trial.run(mu) for mu in self.config.frictions}


def kind_at(truth: FrameTruth, object_id: int, mask: Mask | None) -> str:
    """Return the kind of symmetry of the true region of an object that most of `mask` is on.

    Without a mask, or if it is on none, the region of which most is seen counts.
    """
    instances = [i for i in truth.instances if i.object_id == object_id]
    if not instances:
        return "none"
    seen = [int(i.mask.sum()) for i in instances]
    covered = [0 if mask is None else int((i.mask & mask).sum()) for i in instances]
    return kind_of(instances[int(np.argmax(covered if any(covered) else seen))].symmetries)
