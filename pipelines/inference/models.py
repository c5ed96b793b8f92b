"""The two networks of `infer`, loaded once a process."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.errors import MissingInputError

if TYPE_CHECKING:
    from pipelines.network.detector import RegionDetector
    from pipelines.network.predictor import GraspPredictor

WEIGHTS = Path(__file__).parent.parent / "weights"
DETECTOR_WEIGHTS = WEIGHTS / "detector.safetensors"
NETWORK_WEIGHTS = WEIGHTS / "network.safetensors"


def existing_weights(path: Path, written_by: str) -> Path:
    """Return `path` if it is there.

    Raises:
        MissingInputError: it is not; the message names the command that writes it.
    """
    if not path.is_file():
        raise MissingInputError(path, written_by)
    return path


@lru_cache(maxsize=2)
def detector(path: Path, device: str) -> RegionDetector:
    """Return the region detector of the weights `path`."""
    from pipelines.network.detector import RegionDetector  # noqa: PLC0415 - torch is slow to load

    return RegionDetector.load(existing_weights(path, "symgrasp finetune-detector"), device)


@lru_cache(maxsize=2)
def predictor(path: Path, device: str) -> GraspPredictor:
    """Return the grasp network of the weights `path`."""
    from pipelines.network.predictor import GraspPredictor  # noqa: PLC0415 - torch is slow to load

    return GraspPredictor.load(existing_weights(path, "symgrasp train"), device)
