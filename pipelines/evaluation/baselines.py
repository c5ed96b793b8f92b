"""Baselines on the regions of `infer`: true symmetries, planar grasps, random grasps.

All baselines plan from the same observation as `infer`, with the same selection of grasps. The
oracle takes the true symmetries and the true affordance of a region's object: its figures are the
method's with a perfect network. Planar grasps ranked by the grasp critic are the control for the
benefit of symmetry: they differ from ours in the candidates alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from pipelines.array_types import Array, Mask
from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.errors import SymgraspError
from pipelines.evaluation.frame_scores import (
    RegionOwners,
    RegionRow,
    assign_regions,
    owned_by_nearest,
)
from pipelines.evaluation.predictions import FramePredictions, RowPredictions
from pipelines.evaluation.rows import BASELINE_ROWS, OURS
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.passes import Pass, RegionModel, planar_pass, random_pass
from pipelines.grasping.planner import RegionPlanner
from pipelines.grasping.ranking.ranking import Critic
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.completion import completions
from pipelines.inference import models
from pipelines.inference.observation import observe
from pipelines.inference.regions.predicted_regions import NUM_REGION_POINTS

OTHER_FOCAL_LENGTH = 0.1  # relative difference beyond a calibration's, chosen by eye


@dataclass(frozen=True)
class Baselines:
    """The baselines, with the gripper and the settings of `infer`.

    `critic` ranks the grasps of oracle and planar-critic, as in `infer`; None for Eq. 8.
    """

    reader: TruthReader
    gripper: Gripper
    config: InferConfig
    critic: Critic | None = None

    @classmethod
    def of(cls, reader: TruthReader, gripper: Gripper) -> "Baselines":
        """Return the baselines for the default settings of `infer`."""
        return cls(reader, gripper, InferConfig(), models.grasp_critic())

    def rows(
        self,
        masks: list[Mask],
        owners: RegionOwners,
        files: FrameFiles,
        truth: FrameTruth,
        rng: np.random.Generator,
    ) -> dict[str, RowPredictions]:
        """Return the rows `BASELINE_ROWS` on the regions `masks`, each (H, W), of one frame.

        `owners`: object and true region of each mask. `rng`: of the sampling and of `random`.
        """
        if not masks:
            rows = {name: RowPredictions([], []) for name in BASELINE_ROWS}
            return rows | {"oracle": RowPredictions([], [], symmetries=[])}
        observation = observe(self.reader.root.read_frame(files), self.config, rng, regions=masks)
        symmetries = [true_symmetries(instance, truth) for instance in owners.instance]
        clouds = [_thinned(cloud, rng) for cloud in observation.clouds]
        scene = observation.scene
        regions = self._true_regions(clouds, scene, symmetries, owners, truth)
        by_critic = RegionPlanner(self.gripper, self.config.selection, self.critic)
        by_eq8 = RegionPlanner(self.gripper, self.config.selection)
        oracle = [by_critic.plan(region, scene) for region in regions]

        def by_pass(only: Pass, planner: RegionPlanner) -> RowPredictions:
            """Return the grasps of one pass, found on the measured points alone."""
            measured = map(RegionModel, observation.clouds)
            return RowPredictions.from_ranked([planner.plan(r, scene, (only,)) for r in measured])

        return {
            "oracle": RowPredictions.from_ranked(oracle, symmetries),
            "planar": by_pass(planar_pass(), by_eq8),
            "planar-critic": by_pass(planar_pass(), by_critic),
            "random": by_pass(random_pass(rng), by_eq8),
        }

    def _true_regions(
        self,
        clouds: list[RegionCloud],
        scene: SceneCloud,
        symmetries: list[SymmetrySlots],
        owners: RegionOwners,
        truth: FrameTruth,
    ) -> list[RegionModel]:
        selection = self.config.selection
        resolution = selection.feasibility.scene_resolution
        unseen = completions(clouds, scene, symmetries, selection.symmetry, resolution)
        return [
            RegionModel(cloud, known, self._true_affordance(cloud.points, owner, truth), completion)
            for cloud, known, owner, completion in zip(
                clouds, symmetries, owners.object_id, unseen, strict=True
            )
        ]

    def _true_affordance(self, points: Array, owner: int, truth: FrameTruth) -> Array:
        """Return (n,) true affordance of the surface nearest to each of `points`, camera frame."""
        if owner not in truth.scene.poses or not len(points):
            return np.zeros(len(points))
        labels = self.reader.affordance(owner)
        local = transform_points(invert(truth.scene.poses[owner]), points)
        _, nearest = KDTree(labels.points).query(local)
        return np.asarray(labels.affordance[nearest], np.float64)


def rows_of(
    predictions: Mapping[str, FramePredictions],
    files: FrameFiles,
    truth: FrameTruth,
    config: EvaluateConfig,
    baselines: Baselines | None,
    seed: int,
) -> dict[str, RegionRow]:
    """Return the rows of one frame, and the rows of `baselines`, if any, on our regions.

    `predictions`: by row, including ours; each row has its own regions. The same `seed` gives the
    same random grasps.

    Raises:
        SymgraspError: predictions are of images that another camera took.
    """
    for each in predictions.values():
        _refuse_another_camera(each, truth)
    rows = {
        name: RegionRow(each.row, each.masks, assign_regions(each.masks, truth, config))
        if each.anywhere is None
        else owned_by_nearest(each.anywhere, truth)
        for name, each in predictions.items()
    }
    if baselines is not None:
        ours, rng = rows[OURS], np.random.default_rng([seed, files.scene_id, files.frame_id])
        planned = baselines.rows(ours.masks, ours.owners, files, truth, rng)
        rows |= {name: replace(ours, predictions=row) for name, row in planned.items()}
    return rows


def _refuse_another_camera(found: FramePredictions, truth: FrameTruth) -> None:
    """Raise SymgraspError if the size or the focal length of the predictions' images is another."""
    theirs, ours = found.intrinsics, truth.intrinsics
    if theirs is None:
        return
    is_same_size = (theirs.width, theirs.height) == (ours.width, ours.height)
    if is_same_size and abs(theirs.fx / ours.fx - 1.0) < OTHER_FOCAL_LENGTH:
        return
    raise SymgraspError(
        f"{found.name} was {theirs.width}x{theirs.height} pixels with a focal length of "
        f"{theirs.fx:.0f} when its grasps were found, and is {ours.width}x{ours.height} with "
        f"{ours.fx:.0f} in this dataset; give the dataset that infer was run on"
    )


def true_symmetries(instance: int, truth: FrameTruth) -> SymmetrySlots:
    """Return the symmetries of the true region with index `instance`; none for -1."""
    true = () if instance < 0 else truth.instances[instance].symmetries
    return SymmetrySlots.from_symmetries(true)


def _thinned(region: RegionCloud, rng: np.random.Generator) -> RegionCloud:
    """Return `region` with as many points as the network would see, in their order."""
    if len(region) <= NUM_REGION_POINTS:
        return region
    kept = np.sort(rng.choice(len(region), NUM_REGION_POINTS, replace=False))
    return region[kept]
