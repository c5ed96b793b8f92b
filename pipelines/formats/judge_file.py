"""`plane_judge.safetensors` and `hand_judge.safetensors`: the weights of judges (D. 80, D. 82)."""

from pathlib import Path

from pipelines.errors import FormatError
from pipelines.formats.checkpoints import load_arrays
from pipelines.grasping import hand_views, mirror_views, plane_evidence
from pipelines.grasping.point_judge import PointJudge

PLANES, HANDS = "PlaneJudge", "HandJudge"  # what the files say they hold
WIDTHS = {
    PLANES: (
        mirror_views.POINT_FEATURES + mirror_views.PLANE_FEATURES,
        len(plane_evidence.FEATURES),
    ),
    HANDS: (hand_views.POINT_FEATURES, hand_views.HAND_FEATURES),
}


def read(path: Path, model: str) -> PointJudge:
    """Read what `docs/train_plane_judge.py` or `docs/train_hand_judge.py` wrote.

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
