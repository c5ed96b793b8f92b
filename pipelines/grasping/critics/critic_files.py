"""Weights files of the critics (D. 80, D. 82, D. 148): safetensors that name every feature."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.contents import json_object
from pipelines.errors import FormatError
from pipelines.grasping.critics.point_critic import FeatureNames, PointCritic
from pipelines.grasping.ranking import grasp_features
from pipelines.grasping.symmetries import axis_evidence, mirror_views, plane_evidence
from pipelines.storage.checkpoints import load_arrays

AXES, PLANES, GRASPS = "AxisCritic", "PlaneCritic", "GraspCritic"  # `model` of the metadata
FEATURES = {
    AXES: FeatureNames(
        axis_evidence.POINT_FEATURES, axis_evidence.AXIS_FEATURES, axis_evidence.FEATURES
    ),
    PLANES: FeatureNames(
        mirror_views.POINT_FEATURES, mirror_views.PLANE_FEATURES, plane_evidence.FEATURES
    ),
    GRASPS: FeatureNames(grasp_features.POINT_FEATURES, (), grasp_features.CANDIDATE_FEATURES),
}
WRITTEN_BY = {  # commands that write the files
    AXES: "symgrasp train-critic axes",
    PLANES: "symgrasp train-critic planes",
    GRASPS: "symgrasp train-critic grasps",
}


def metadata_of(model: str) -> dict[str, str]:
    """Return the metadata of a weights file of `model`: its name and the names of its features."""
    return {"model": model, "features": FEATURES[model].as_text()}


def read_point_critic(path: Path, model: str) -> PointCritic:
    """Read the weights of `model`: `AXES`, `PLANES` or `GRASPS`.

    Raises:
        FormatError: the file holds no weights of this critic, or has other features.
    """
    return PointCritic(FEATURES[model], _read(path, model, FEATURES[model].weight_shapes()))


def _read(
    path: Path, model: str, shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, np.ndarray[Any, Any]]:
    """Read the tensors named in `shapes`, and check the file's metadata."""
    arrays, metadata = load_arrays(path)
    found = metadata.get("model", "no known network")
    if found != model:
        raise FormatError(path, f"holds {found}", f"weights of {model} are expected")
    _check_features(path, model, metadata.get("features", "{}"))
    for name, shape in shapes.items():
        if name not in arrays or arrays[name].shape != shape:
            there = arrays[name].shape if name in arrays else "not there"
            raise FormatError(path, f"{name} is {there}", f"shape {shape} is expected")
    return {name: arrays[name] for name in shapes}


def _check_features(path: Path, model: str, text: str) -> None:
    """Raise FormatError unless the metadata's `text` names the computed features."""
    cure = f"make the file again with `{WRITTEN_BY[model]}`"
    found = json_object(path, text, "features")
    for group, names in vars(FEATURES[model]).items():
        stored = found.get(group)
        if not isinstance(stored, list):
            raise FormatError(path, f"does not name its {group} features", cure)
        if len(stored) != len(names):
            counts = f"takes {len(stored)} {group} features, not {len(names)}"
            raise FormatError(path, counts, cure)
        for place, (there, here) in enumerate(zip(stored, names, strict=True), 1):
            if there != here:
                problem = f"takes {there} as {group} feature {place}, where {here} is computed"
                raise FormatError(path, problem, cure)
