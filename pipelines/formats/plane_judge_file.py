"""`plane_judge.safetensors`: the weights of the network that judges mirror planes (D. 80)."""

from pathlib import Path

from pipelines.errors import FormatError
from pipelines.formats.checkpoints import load_weights
from pipelines.grasping.plane_judge import PlaneJudge

MODEL = "PlaneJudge"


def read(path: Path) -> PlaneJudge:
    """Read what `docs/train_plane_judge.py` wrote.

    Raises:
        FormatError: the file holds no weights of a plane judge.
    """
    tensors, metadata = load_weights(path)
    found = metadata.get("model", "no network that is known")
    if found != MODEL:
        raise FormatError(path, f"holds {found}", f"weights of {MODEL} are expected")
    try:
        return PlaneJudge.of({name: tensor.numpy() for name, tensor in tensors.items()})
    except KeyError as error:
        raise FormatError(
            path, f"has no {error.args[0]}", "give weights of this version"
        ) from error
