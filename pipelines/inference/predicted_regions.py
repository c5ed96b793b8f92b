"""The predictions of the grasp network for the regions of one frame (Sec. III-E)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping.candidates.decoding import average_symmetries
from pipelines.grasping.observation import RegionCloud

Array = NDArray[np.float64]


class RegionPrediction(Protocol):
    """The network's output for n of one region's points, m of which vote for symmetries."""

    @property
    def index(self) -> NDArray[Any]:
        """(n,) which points of the region."""

    @property
    def affordance(self) -> NDArray[Any]:
        """(n,) 0 to 1."""

    @property
    def telling(self) -> NDArray[Any]:
        """(m,) which of the n vote for symmetries."""

    @property
    def existence(self) -> NDArray[Any]:
        """(m, 5) probabilities."""

    @property
    def center(self) -> NDArray[Any]:
        """(m, 5, 3) metres, camera frame."""

    @property
    def direction(self) -> NDArray[Any]:
        """(m, 5, 3) unit, camera frame."""


class Predictor(Protocol):
    """A network that predicts affordance and symmetries of region clouds."""

    def predict(self, clouds: Sequence[Array], table: Plane | None) -> Sequence[RegionPrediction]:
        """Return one prediction for each cloud (n, 3) on `table`, camera frame."""


@dataclass(frozen=True)
class PredictedRegion:
    """A region as the network sees it.

    Attributes:
        cloud: the n points that it looked at.
        affordance: (n,) 0 to 1.
        slots: its symmetries, averaged over the points; camera frame.
    """

    cloud: RegionCloud
    affordance: Array
    slots: SymmetrySlots


def predicted_regions(
    clouds: Sequence[RegionCloud], table: Plane | None, predictor: Predictor
) -> list[PredictedRegion]:
    """Return what `predictor` says of each of `clouds` on `table`, camera frame."""
    predictions = predictor.predict([cloud.points for cloud in clouds], table)
    return [_region(*each) for each in zip(clouds, predictions, strict=True)]


def _region(cloud: RegionCloud, prediction: RegionPrediction) -> PredictedRegion:
    affordance = np.asarray(prediction.affordance, np.float64)
    votes = prediction.existence, prediction.center, prediction.direction
    slots = average_symmetries(*votes, affordance[prediction.telling])
    return PredictedRegion(cloud[prediction.index], affordance, slots)
