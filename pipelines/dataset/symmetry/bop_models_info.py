"""BOP's `models_info.json`: sizes and rotations of objects, millimetres, the object's frame.

    {"1": {"diameter", "min_x", "min_y", "min_z", "size_x", "size_y", "size_z",
           "symmetries_discrete": [[16 numbers: a rigid (4, 4) transform, row by row], ...],
           "symmetries_continuous": [{"axis": [3], "offset": [3]}, ...]}}

BOP has rotations only, so reflections are not written. A sphere is written as three axes through
its centre.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.array_types import Array
from pipelines.contents import reading
from pipelines.errors import FormatError, SymgraspError
from pipelines.geometry.meshes.diameter import diameter
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rotation_group import (
    PARALLEL_COSINE,
    SAME_ROTATION,
    implied_rotations,
    turn_of,
)
from pipelines.geometry.symmetry import RotationSymmetry, SphereSymmetry, Symmetry
from pipelines.storage.files import read_json, write_json

MILLIMETRES = 1000.0  # per metre
NUMBERED = re.compile(r"(?:obj_)?(\d+)")
SAME_SIZE = 0.02  # relative difference of diameters of one mesh
RIGID_TOLERANCE = 1e-3  # of the entries of R R^T and of the determinant


@dataclass(frozen=True)
class ModelInfo:
    """One object of the file: lengths in millimetres, rigid transforms (4, 4)."""

    diameter: float | None
    discrete: tuple[Array, ...]
    continuous: tuple[tuple[Array, Array], ...]  # axis (3,) unit, offset (3,)


def object_key(name: str) -> str | None:
    """Return the key in the file of an object named `obj_000005` or `005`: `5`; else None."""
    match = NUMBERED.fullmatch(name)
    return None if match is None else str(int(match[1]))


def keys_of(names: Sequence[str]) -> dict[str, str]:
    """Return the key of each name: its number, or its position from 1 if any name has no number."""
    keys = [object_key(name) for name in names]
    if None in keys or len(set(keys)) < len(keys):
        keys = [str(place) for place in range(1, len(names) + 1)]
    return {name: str(key) for name, key in zip(names, keys, strict=True)}


def write(path: Path, objects: Mapping[str, tuple[Mesh, Sequence[Symmetry]]]) -> None:
    """Write the size of each named object, and the rotations implied by its symmetries."""
    keys = keys_of(list(objects))
    content = {
        keys[name]: entry_of(mesh, symmetries) | {"name": name}
        for name, (mesh, symmetries) in objects.items()
    }
    write_json(path, content)


def entry_of(mesh: Mesh, symmetries: Sequence[Symmetry]) -> dict[str, Any]:
    """Return the entry, in millimetres, of one object, whose mesh and symmetries are in metres."""
    low, high = mesh.bounds
    size = MILLIMETRES * diameter(mesh.vertices[np.unique(mesh.faces)])
    entry: dict[str, Any] = {"diameter": size}
    entry |= {f"min_{axis}": float(MILLIMETRES * low[i]) for i, axis in enumerate("xyz")}
    entry |= {f"size_{axis}": float(MILLIMETRES * (high - low)[i]) for i, axis in enumerate("xyz")}
    rotations = implied_rotations(symmetries)
    if len(rotations.discrete):
        stretched = rotations.discrete.copy()
        stretched[:, :3, 3] *= MILLIMETRES
        entry["symmetries_discrete"] = stretched.reshape(-1, 16).tolist()
    if rotations.continuous:
        entry["symmetries_continuous"] = [
            {"axis": axis.axis.tolist(), "offset": (MILLIMETRES * axis.point).tolist()}
            for axis in rotations.continuous
        ]
    return entry


def read(path: Path) -> dict[str, ModelInfo]:
    """Read the objects of the file, by key, and by `name` if an entry has one.

    Raises:
        FormatError: the file is no models_info.json; the message names the entry.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not all(isinstance(e, dict) for e in content.values()):
        raise FormatError(path, "this is no models_info.json", '{"1": {"diameter": ...}, ...}')
    infos = {key: _info(path, key, entry) for key, entry in content.items()}
    named = {str(entry["name"]): infos[key] for key, entry in content.items() if "name" in entry}
    return infos | named


def symmetries_of(info: ModelInfo, mesh: Mesh) -> list[Symmetry]:
    """Return the rotation or sphere of `info`, in the frame and unit of `mesh`; at most one.

    Several continuous axes are a sphere; of several n-fold axes, the axis with the highest n is
    returned, the first listed among equals.

    Raises:
        SymgraspError: the size of the mesh, in metres or millimetres, differs from the file's.
    """
    scale = _unit_of(info, mesh)
    if info.continuous:
        (axis, offset), *others = info.continuous
        if any(abs(axis @ other) < PARALLEL_COSINE for other, _ in others):
            return [SphereSymmetry(scale * _meeting_point(info.continuous))]
        return [RotationSymmetry(axis, scale * offset)]
    turns = [turn_of(transform) for transform in info.discrete]
    # Files that list a whole group include the identity, which has no axis.
    turns = [(axis, angle, point) for axis, angle, point in turns if angle > SAME_ROTATION]
    best: RotationSymmetry | None = None
    for axis, _, point in turns:
        angles = [angle for other, angle, _ in turns if abs(other @ axis) > PARALLEL_COSINE]
        order = round(2.0 * np.pi / min(angles))
        if order >= 2 and (best is None or order > (best.order or 0)):
            best = RotationSymmetry(axis, scale * point, order)
    return [] if best is None else [best]


def _unit_of(info: ModelInfo, mesh: Mesh) -> float:
    """Return the mesh's units per millimetre: 0.001, or 1 if the mesh is in millimetres."""
    if info.diameter is None:
        return 1.0 / MILLIMETRES
    size = diameter(mesh.vertices[np.unique(mesh.faces)])
    for scale in (1.0 / MILLIMETRES, 1.0):
        if abs(size / (scale * info.diameter) - 1.0) < SAME_SIZE:
            return scale
    raise SymgraspError(
        f"the mesh is {size:.4g} across and models_info.json states {info.diameter:.4g} mm; "
        "give the file of these meshes, in metres or millimetres"
    )


def _meeting_point(axes: Sequence[tuple[Array, Array]]) -> Array:
    """Return the point (3,) nearest to all lines."""
    across = [np.eye(3) - np.outer(axis, axis) for axis, _ in axes]
    target = sum((a @ offset for a, (_, offset) in zip(across, axes, strict=True)), np.zeros(3))
    return np.asarray(np.linalg.lstsq(sum(across, np.zeros((3, 3))), target, rcond=None)[0])


def _info(path: Path, key: str, entry: Mapping[str, Any]) -> ModelInfo:
    with reading(path, f"object {key}", "4x4 transforms, and axis with offset"):
        size = None if entry.get("diameter") is None else float(entry["diameter"])
        if size is not None and not 0 < size < np.inf:
            raise ValueError(f"its diameter is {size:g}")
        discrete = tuple(_rigid(values) for values in entry.get("symmetries_discrete", []))
        continuous = tuple(
            (_unit_axis(each["axis"]), np.asarray(each["offset"], np.float64).reshape(3))
            for each in entry.get("symmetries_continuous", [])
        )
        return ModelInfo(size, discrete, continuous)


def _rigid(values: Any) -> Array:  # noqa: ANN401 - JSON
    T = np.asarray(values, np.float64).reshape(4, 4)
    R = T[:3, :3]
    if not np.isfinite(T).all() or np.abs(R @ R.T - np.eye(3)).max() > RIGID_TOLERANCE:
        raise ValueError("a discrete symmetry is no rigid transform")
    if np.linalg.det(R) < 0:
        raise ValueError("a discrete symmetry is a reflection, which no rigid motion is")
    return T


def _unit_axis(values: Any) -> Array:  # noqa: ANN401 - JSON
    axis = np.asarray(values, np.float64).reshape(3)
    length = float(np.linalg.norm(axis))
    if not (np.isfinite(axis).all() and length > 0):
        raise ValueError("an axis has no direction")
    return axis / length
