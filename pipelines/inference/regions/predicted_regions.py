"""The models of the regions of one frame: fitted predictions of the network (Sec. III-E)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.configs import NetworkConfig, SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.symmetry_votes import mean_slots
from pipelines.grasping.passes import RegionModel
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.completion import completions
from pipelines.grasping.symmetries.grounding import SymmetryCritics, ground_symmetries

if TYPE_CHECKING:
    from pipelines.network.predictor import GraspPredictor

NUM_REGION_POINTS = NetworkConfig.num_points  # of a region without a network, as with one

# A compared method: returns the symmetries, camera frame, of a region, given colours (H, W, 3).
RegionMethod = Callable[[RegionCloud, SceneCloud, NDArray[np.uint8]], SymmetrySlots]


@dataclass(frozen=True)
class PredictedRegion:
    """The network's prediction for a region.

    Attributes:
        cloud: the n input points of the network.
        affordance: (n,) 0 to 1.
        slots: symmetries of the region, averaged over the points; camera frame.
    """

    cloud: RegionCloud
    affordance: Array
    slots: SymmetrySlots


def predicted_regions(
    clouds: Sequence[RegionCloud], table: Plane | None, predictor: "GraspPredictor"
) -> list[PredictedRegion]:
    """Return the predictions for `clouds` on `table`, camera frame."""
    predictions = predictor.predict([cloud.points for cloud in clouds], table)
    regions = []
    for cloud, each in zip(clouds, predictions, strict=True):
        affordance = np.asarray(each.affordance, np.float64)
        slots = mean_slots(each.existence, each.center, each.direction)
        regions.append(PredictedRegion(cloud[each.index], affordance, slots))
    return regions


def compared_regions(
    clouds: Sequence[RegionCloud], scene: SceneCloud, color: NDArray[np.uint8], method: RegionMethod
) -> list[PredictedRegion]:
    """Return `clouds` with the symmetries that `method` finds; all their points are graspable.

    `color`: (H, W, 3) RGB of the frame.
    """
    regions = []
    for cloud in clouds:
        slots = method(cloud, scene, color)
        chosen = np.random.default_rng(0).permutation(len(cloud))[:NUM_REGION_POINTS]
        regions.append(PredictedRegion(cloud[chosen], np.ones(len(chosen)), slots))
    return regions


def region_models(
    predicted: Sequence[PredictedRegion],
    scene: SceneCloud,
    config: SelectionConfig,
    critics: SymmetryCritics | None,
) -> list[RegionModel]:
    """Return the models of all regions of a frame; without critics, symmetries are not fitted."""
    clouds, symmetries = [p.cloud for p in predicted], [p.slots for p in predicted]
    if critics is not None:
        sources = config.symmetry.candidates
        symmetries = [
            ground_symmetries(slots, cloud, scene, critics, sources)
            for slots, cloud in zip(symmetries, clouds, strict=True)
        ]
    resolution = config.feasibility.scene_resolution
    unseen = completions(clouds, scene, symmetries, config.symmetry, resolution)
    affordance = [p.affordance for p in predicted]
    return [*map(RegionModel, clouds, symmetries, affordance, unseen)]
