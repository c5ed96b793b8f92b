"""`plane_judge.safetensors` and `hand_judge.safetensors`: the weights of judges (D. 80, D. 82)."""

from pathlib import Path

from pipelines.errors import FormatError
from pipelines.formats.checkpoints import load_arrays
from pipelines.grasping.point_judge import PointJudge

PLANES, HANDS = "PlaneJudge", "HandJudge"  # what the files say they hold


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
        return PointJudge.of(arrays)
    except KeyError as error:
        raise FormatError(
            path, f"has no {error.args[0]}", "give weights of this version"
        ) from error
