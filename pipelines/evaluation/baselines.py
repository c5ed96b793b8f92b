"""Baselines on the regions of `infer`: the true symmetries, the boundary, chance.

All plan from the observation that `infer` plans from, with the same selection of grasps. The oracle
takes the true symmetries and the true affordance of the object that a region lies on: its figures
are those of the method with a perfect network.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipelines.configs import InferConfig
from pipelines.dataset.graspnet.graspnet import FrameFiles
from pipelines.evaluation.frame_scores import RegionOwners
from pipelines.evaluation.predictions import FramePredictions, RowPredictions
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.candidates.completion import completions
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.ranking.ranking import Critic
from pipelines.grasping.region_grasping import plan_planar, plan_random, plan_region
from pipelines.inference import models
from pipelines.inference.observation import observe

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NUM_POINTS = 1500  # of a region that carry affordance, as the network has


@dataclass(frozen=True)
class Baselines:
    """The baselines, with the settings of `infer`.

    Attributes:
        reader: of the ground truth.
        gripper: as for `infer`.
        config: as for `infer`.
        critic: ranks the oracle's grasps, as `infer` ranks its own; None for Eq. 8.
    """

    reader: TruthReader
    gripper: Gripper
    config: InferConfig
    critic: Critic | None = None

    @classmethod
    def of(cls, reader: TruthReader, gripper: Gripper) -> "Baselines":
        """Return the baselines of `infer` as it is by default."""
        return cls(reader, gripper, InferConfig(), models.grasp_critic())

    def rows(
        self,
        masks: list[Mask],
        owners: RegionOwners,
        files: FrameFiles,
        truth: FrameTruth,
        rng: np.random.Generator,
    ) -> dict[str, RowPredictions]:
        """Return the rows oracle, planar and random on the regions `masks` of one frame."""
        if not masks:
            nothing = RowPredictions([], [])
            return {"oracle": replace(nothing, slots=[]), "planar": nothing, "random": nothing}
        frame = self.reader.root.read_frame(files)
        seen = observe(frame, self.config, rng, regions=masks)
        scene, regions = seen.scene, seen.clouds
        selection, gripper = self.config.selection, self.gripper
        slots = [true_slots(instance, truth) for instance in owners.instance]
        oracle = self._plans_with_truth(
            [_thinned(region, rng) for region in regions], scene, slots, owners, truth
        )
        planar = [plan_planar(region, scene, gripper, selection) for region in regions]
        drawn = [plan_random(region, scene, gripper, selection, rng) for region in regions]
        return {
            "oracle": RowPredictions.from_ranked(oracle, slots),
            "planar": RowPredictions.from_ranked(planar),
            "random": RowPredictions.from_ranked(drawn),
        }

    def _plans_with_truth(
        self,
        regions: list[RegionCloud],
        scene: SceneCloud,
        slots: list[SymmetrySlots],
        owners: RegionOwners,
        truth: FrameTruth,
    ) -> list[RankedGrasps]:
        selection, plans = self.config.selection, []
        completed = completions(regions, scene, slots, selection)
        for region, known, owner, unseen in zip(
            regions, slots, owners.object_id, completed, strict=True
        ):
            affordance = self._true_affordance(region.points, owner, truth)
            plans.append(
                plan_region(
                    region, scene, known, affordance, self.gripper, selection, self.critic, unseen
                )
            )
        return plans

    def _true_affordance(self, points: Array, owner: int, truth: FrameTruth) -> Array:
        """Return (n,) the affordance of the object's surface nearest to `points`, camera frame."""
        if owner not in truth.scene.poses or not len(points):
            return np.zeros(len(points))
        labels = self.reader.affordance(owner)
        local = transform_points(invert(truth.scene.poses[owner]), points)
        _, nearest = KDTree(labels.points).query(local)
        return np.asarray(labels.affordance[nearest], np.float64)


def rows_of(
    predictions: FramePredictions,
    owners: RegionOwners,
    files: FrameFiles,
    truth: FrameTruth,
    baselines: Baselines | None,
    seed: int,
) -> dict[str, RowPredictions]:
    """Return our row and, where wanted, those of `baselines`; one `seed` gives the same grasps."""
    rows = {"ours": predictions.row}
    if baselines is not None:
        rng = np.random.default_rng([seed, files.scene_id, files.frame_id])
        rows |= baselines.rows(predictions.masks, owners, files, truth, rng)
    return rows


def true_slots(instance: int, truth: FrameTruth) -> SymmetrySlots:
    """Return the slots of the true region with index `instance`; none for -1."""
    if instance < 0:
        return SymmetrySlots.empty()
    return SymmetrySlots.from_symmetries(truth.instances[instance].symmetries)


def _thinned(region: RegionCloud, rng: np.random.Generator) -> RegionCloud:
    if len(region) <= NUM_POINTS:
        return region
    kept = np.sort(rng.choice(len(region), NUM_POINTS, replace=False))
    return replace(region, points=region.points[kept], normals=region.normals[kept])
