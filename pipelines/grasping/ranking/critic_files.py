"""`plane_judge.safetensors` and `hand_judge.safetensors`: the weights of judges (D. 80, D. 82)."""

from pathlib import Path

from pipelines.errors import FormatError
from pipelines.grasping.candidates import mirror_views, plane_evidence
from pipelines.grasping.ranking import grasp_features
from pipelines.grasping.ranking.point_critic import PointJudge
from pipelines.storage.checkpoints import load_arrays

PLANES, HANDS = "PlaneJudge", "HandJudge"  # what the files say they hold
WIDTHS = {
    PLANES: (
        mirror_views.POINT_FEATURES + mirror_views.PLANE_FEATURES,
        len(plane_evidence.FEATURES),
    ),
    HANDS: (grasp_features.POINT_FEATURES, grasp_features.HAND_FEATURES),
}


def read(path: Path, model: str) -> PointJudge:
    """Read what `tools/train_plane_critic.py` or `tools/train_grasp_critic.py` wrote.

    Args:
        path: of the weights.
        model: `PLANES` or `HANDS`.

    Raises:
        FormatError: the file holds no weights of such a judge.
    """
    arrays, metadata = load_arrays(path)
    found = metadata.get("model", "no network that is known")
    if found != model:
        raise FormatError(path, f"holds {found}", f"weights of {model} are expected")
    try:
        judge = PointJudge.of(arrays)
    except KeyError as error:
        raise FormatError(
            path, f"has no {error.args[0]}", "give weights of this version"
        ) from error
    if judge.widths != WIDTHS[model]:
        takes, gets = "{} numbers of a point and {}".format(*judge.widths), WIDTHS[model]
        raise FormatError(
            path, f"takes {takes}, not {gets[0]} and {gets[1]}", "give weights of this version"
        )
    return judge
