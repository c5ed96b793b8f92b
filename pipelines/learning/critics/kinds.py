"""The kinds of critics: their features, their points, and the models that they need."""

from dataclasses import dataclass
from typing import Literal

from pipelines.errors import UnknownNameError
from pipelines.grasping.critics import critic_files
from pipelines.grasping.critics.point_critic import FeatureNames
from pipelines.grasping.ranking import grasp_features
from pipelines.grasping.ranking.grasp_features import GraspPointFeature
from pipelines.grasping.symmetries import axis_evidence, mirror_views
from pipelines.grasping.symmetries.mirror_views import PlanePointFeature

KindName = Literal["axes", "planes", "grasps"]


@dataclass(frozen=True)
class CriticKind:
    """A kind of critic.

    Attributes:
        name: axes, planes or grasps.
        model: name of the critic in its weights file.
        needs: models whose candidates the critic learns from, as named in `ModelPaths`.
        num_points: number of points of a candidate.
        mirrored: columns of the points that change sign in a mirror image, as true as the original.
        mirrored_candidates: features of a candidate that change sign with them.
        chooses: whether the critic also learns to choose among the candidates of a group.
    """

    name: KindName
    model: str
    needs: tuple[str, ...]
    num_points: int
    mirrored: tuple[int, ...]
    mirrored_candidates: tuple[str, ...] = ()
    chooses: bool = False

    @property
    def features(self) -> FeatureNames:
        """Names of the critic's features."""
        return critic_files.FEATURES[self.model]


CRITIC_KINDS: dict[str, CriticKind] = {
    each.name: each
    for each in (
        CriticKind(
            "axes",
            critic_files.AXES,
            ("detector", "network"),
            mirror_views.NUM_POINTS,
            (
                PlanePointFeature.ALONG_NORMAL,
                PlanePointFeature.NORMAL_NORMAL,
                axis_evidence.TANGENTIAL,
            ),
        ),
        CriticKind(
            "planes",
            critic_files.PLANES,
            ("detector", "network", "axis_critic"),
            mirror_views.NUM_POINTS,
            (PlanePointFeature.ALONG_ACROSS, PlanePointFeature.NORMAL_ACROSS),
        ),
        CriticKind(  # the gripper is its own mirror image in the plane of approach and closing
            "grasps",
            critic_files.GRASPS,
            ("detector", "network", "axis_critic", "plane_critic"),
            grasp_features.NUM_POINTS,
            (GraspPointFeature.ALONG_BINORMAL, GraspPointFeature.NORMAL_BINORMAL),
            ("up_binormal", "mean_binormal", "middle_binormal"),
            chooses=True,
        ),
    )
}


def critic_kind(name: str) -> CriticKind:
    """Return the kind called `name`.

    Raises:
        UnknownNameError: the name is unknown.
    """
    if name not in CRITIC_KINDS:
        raise UnknownNameError("critic", name, CRITIC_KINDS)
    return CRITIC_KINDS[name]
