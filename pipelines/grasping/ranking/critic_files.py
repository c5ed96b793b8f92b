"""Weights of critics, `plane_critic.safetensors` and `grasp_critic.safetensors` (D. 80, D. 82)."""

from pathlib import Path

from pipelines.errors import FormatError
from pipelines.grasping.candidates import mirror_views, plane_evidence
from pipelines.grasping.ranking import grasp_features
from pipelines.grasping.ranking.point_critic import PointCritic
from pipelines.storage.checkpoints import load_arrays

PLANES, GRASPS = "PlaneCritic", "GraspCritic"  # what the files say they hold
WIDTHS = {
    PLANES: (
        mirror_views.POINT_FEATURES + mirror_views.PLANE_FEATURES,
        len(plane_evidence.FEATURES),
    ),
    GRASPS: (grasp_features.POINT_FEATURES, grasp_features.GRASP_FEATURES),
}


def read(path: Path, model: str) -> PointCritic:
    """Read what `tools/train_plane_critic.py` or `tools/train_grasp_critic.py` wrote.

    Args:
        path: of the weights.
        model: `PLANES` or `GRASPS`.

    Raises:
        FormatError: the file holds no weights of such a critic.
    """
    arrays, metadata = load_arrays(path)
    found = metadata.get("model", "no network that is known")
    if found != model:
        raise FormatError(path, f"holds {found}", f"weights of {model} are expected")
    try:
        critic = PointCritic.of(arrays)
    except KeyError as error:
        raise FormatError(
            path, f"has no {error.args[0]}", "give weights of this version"
        ) from error
    if critic.widths != WIDTHS[model]:
        takes, gets = "{} numbers of a point and {}".format(*critic.widths), WIDTHS[model]
        raise FormatError(
            path, f"takes {takes}, not {gets[0]} and {gets[1]}", "give weights of this version"
        )
    return critic
