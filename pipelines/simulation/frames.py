"""The trials of a frame: the grasps that `evaluate` scores, simulated in the true scene."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.configs import EvaluateConfig, SimulateConfig
from pipelines.dataset import convex_pieces
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.training.coco_instances import kind_of
from pipelines.errors import SymgraspError
from pipelines.evaluation.baselines import Baselines, rows_of
from pipelines.evaluation.frame_scores import RegionRow, best_region
from pipelines.evaluation.predictions import FramePredictions
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.records import number_key
from pipelines.evaluation.runs.trial_records import FrameTrials, Outcome, TrialRecord
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.simulation.trial import Trial
from pipelines.simulation.world import Pieces, at_rest


@dataclass
class PiecesReader:
    """Reads the convex pieces of models from the dataset, else from the folder `cache`."""

    root: GraspNetRoot
    cache: Path
    _pieces: dict[int, Pieces] = field(default_factory=dict)

    def source(self, object_id: int) -> Path:
        """Return the dataset's source of the pieces: the file of pieces, else the mesh."""
        mesh = self.root.model_path(object_id)
        pieces = mesh.with_name("convex.npz")
        return pieces if pieces.is_file() else mesh

    def path(self, object_id: int) -> Path:
        """Return the path of an object's pieces, whether they exist or not."""
        source = self.source(object_id)
        return source if source.suffix == ".npz" else self.cache / f"{object_id:03d}.npz"

    def read(self, object_id: int) -> Pieces:
        """Return the pieces of an object, object frame.

        Raises:
            SymgraspError: there are none, because the mesh could not be cut.
        """
        if object_id not in self._pieces:
            path = self.path(object_id)
            if not path.is_file():
                mesh = self.root.model_path(object_id)
                raise SymgraspError(
                    f"object {object_id:03d} has no convex pieces, because {mesh} is not cut; give "
                    "a mesh of a closed surface"
                )
            self._pieces[object_id] = convex_pieces.read(path)
        return self._pieces[object_id]


@dataclass(frozen=True)
class RestedScene:
    """The objects of a frame at rest."""

    objects: Mapping[int, Pieces]  # convex pieces, object frame
    poses: Mapping[int, Array]  # (4, 4), object to table
    T_table_cam: Array  # (4, 4), of the frame's camera
    surroundings: Pieces  # convex pieces that do not move, table frame


@dataclass
class FrameSimulator:
    """Simulated trials of frames; each object is read once.

    `baselines`: also try the methods of `evaluation.baselines`; `evaluate` with the same `seed`
    scores the same grasps.
    """

    root: GraspNetRoot
    pieces: PiecesReader
    gripper: Gripper
    config: SimulateConfig
    baselines: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        self._rules = EvaluateConfig(
            min_visible_pixels=self.config.min_visible_pixels,
            min_region_share=self.config.min_region_share,
        )
        self._reader = TruthReader(self.root, self._rules)
        self._baselines = Baselines.of(self._reader, self.gripper) if self.baselines else None

    def run(self, predictions: Mapping[str, FramePredictions]) -> FrameTrials:
        """Return the trials of the best grasp on every visible object of a frame.

        `predictions`: of the frame by row, including ours.
        """
        name = predictions[OURS].name
        files = self.root.frame(name)
        truth = self._reader.read(files)
        rows = rows_of(predictions, files, truth, self._rules, self._baselines, self.seed)
        scene, shift = self._rested(truth)
        trials = {row: self._try_row(each, truth, scene) for row, each in rows.items()}
        ours = trials.pop(OURS)
        return FrameTrials(name, truth.split, shift, ours, trials)

    def _rested(self, truth: FrameTruth) -> tuple[RestedScene, float]:
        """Return the scene at rest, and the largest motion of an object until then, metres.

        The motion is 0 for a frame without objects.
        """
        T_table_cam = truth.scene.T_table_cam
        given = {i: T_table_cam @ pose for i, pose in truth.scene.poses.items()}
        objects = {i: self.pieces.read(i) for i in given}
        around = [each.mesh for each in truth.scene.surroundings]
        poses = at_rest(objects, given, around)
        shifts = [float(np.linalg.norm(poses[i][:3, 3] - given[i][:3, 3])) for i in given]
        return RestedScene(objects, poses, T_table_cam, around), max(shifts, default=0.0)

    def _try_row(self, row: RegionRow, truth: FrameTruth, scene: RestedScene) -> list[TrialRecord]:
        """Return the trials of one method, one for every visible object."""
        trials = []
        for object_id in truth.visible:
            region = best_region(object_id, row.predictions, row.owners)
            grasp = GraspPoses.empty() if region is None else row.predictions.best[region]
            mask = None if region is None else row.masks[region]
            outcomes = self._try(scene, object_id, grasp.transformed(scene.T_table_cam))
            trials.append(TrialRecord(object_id, kind_at(truth, object_id, mask), outcomes))
        return trials

    def _try(self, scene: RestedScene, object_id: int, grasp: GraspPoses) -> dict[str, Outcome]:
        """Return the outcomes by friction; `grasp`, table frame, may be empty."""
        if not len(grasp):
            return {number_key(mu): Outcome("no grasp") for mu in self.config.frictions}
        trial = Trial.of(
            scene.objects,
            scene.poses,
            object_id,
            grasp,
            self.gripper,
            self.config,
            scene.surroundings,
        )
        return {number_key(mu): trial.run(mu) for mu in self.config.frictions}


def kind_at(truth: FrameTruth, object_id: int, mask: Mask | None) -> str:
    """Return the kind of symmetry of the object's region that contains most of `mask` (H, W).

    Without a mask, or if no region contains it, the region with most visible pixels counts.
    """
    instances = [i for i in truth.instances if i.object_id == object_id]
    if not instances:
        return "none"
    seen = [int(i.mask.sum()) for i in instances]
    covered = [0 if mask is None else int((i.mask & mask).sum()) for i in instances]
    return kind_of(instances[int(np.argmax(covered if any(covered) else seen))].symmetries)
