"""The small files of a GraspNet-1Billion scene: annotations, meta, cameras, object list.

`annotations/NNNN.xml` holds 6D poses with four decimals, written in the order that the original
reader expects, and read by their tags; `meta/NNNN.mat` holds the same poses in float32. Poses map
object to camera coordinates in metres (despite the tag `pos_in_world`).
"""

import io
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from defusedxml.ElementTree import parse as parse_xml
from numpy.typing import NDArray

from pipelines.array_types import Array, Floats
from pipelines.errors import FormatError
from pipelines.frames.encodings.mat_files import read_mat
from pipelines.geometry.transforms import (
    make_pose,
    matrix_to_quaternion,
    nearest_orthogonal,
    quaternion_to_matrix,
)
from pipelines.storage.array_files import read_npy, write_npy
from pipelines.storage.files import existing, read_text, write_bytes, write_text

log = logging.getLogger(__name__)

CAMERAS = ("kinect", "realsense")
POSE_FIELDS = ("obj_id", "obj_name", "obj_path", "pos_in_world", "ori_in_world")
# A .mat opens with 116 bytes of free text, where scipy puts the time of writing.
MAT_TEXT = b"MATLAB 5.0 MAT-file, written by symgrasp".ljust(116)
OBJECT_ID = re.compile(rb"<obj_id>\s*(\d+)\s*</obj_id>")
NEEDED_FIELDS = ("obj_id", "pos_in_world", "ori_in_world")
# Four decimals of a quaternion turn a pose by up to about 1e-4 rad.
LARGEST_ROUNDING = 5e-4
# Largest error of R^T R, or of a quaternion's length: rounding is far below, faults far above.
RIGID_TOLERANCE = 1e-2
# Largest error of R^T R with which a rotation stays unchanged: single precision is below.
EXACT_TOLERANCE = 1e-6


@dataclass(frozen=True)
class ObjectPose:
    """One object of a frame."""

    object_id: int
    T_cam_obj: Array  # (4, 4) object to camera coordinates, metres
    name: str = ""


@dataclass(frozen=True)
class FrameMeta:
    """Content of `meta/NNNN.mat` (or of a demo folder's `meta.mat`)."""

    intrinsic_matrix: Array  # (3, 3)
    factor_depth: float  # depth units per metre
    object_ids: tuple[int, ...] = ()
    poses: Array | None = None  # (N, 4, 4) object to camera, None if not in the file


def write_annotation(path: Path, poses: Sequence[ObjectPose]) -> None:
    """Write `annotations/NNNN.xml`: four decimals, the children in the original's order."""
    scene = ElementTree.Element("scene")
    for pose in poses:
        name = f"{pose.name or f'{pose.object_id:03d}'}.ply"
        position = pose.T_cam_obj[:3, 3]
        quaternion = matrix_to_quaternion(pose.T_cam_obj[:3, :3])
        texts = (str(pose.object_id), name, f"models/{name}", _four(position), _four(quaternion))
        element = ElementTree.SubElement(scene, "obj")
        for field, text in zip(POSE_FIELDS, texts, strict=True):
            ElementTree.SubElement(element, field).text = text
    ElementTree.indent(scene, space="    ")
    text = ElementTree.tostring(scene, encoding="unicode", short_empty_elements=False)
    write_text(path, f'<?xml version="1.0" ?>\n{text}\n')


def read_annotation_xml(path: Path) -> list[ObjectPose]:
    """Read the poses of `annotations/NNNN.xml` by their tags, objects in file order.

    Raises:
        FormatError: not XML, entities, a tag missing, not a rigid pose, an object listed twice.
    """
    try:
        root = parse_xml(existing(path)).getroot()
    except (ElementTree.ParseError, ValueError) as error:  # refused entities are ValueErrors
        raise FormatError(
            path, f"not XML ({error})", "a GraspNet annotation is expected"
        ) from error
    poses = [_read_object(path, element) for element in (() if root is None else root)]
    ids = [pose.object_id for pose in poses]
    twice = sorted({object_id for object_id in ids if ids.count(object_id) > 1})
    if twice:
        raise FormatError(path, f"lists object {twice[0]} twice", "one pose an object is expected")
    return poses


def annotated_ids(folder: Path) -> list[int]:
    """List the objects that any `NNNN.xml` of `annotations/` names, ascending.

    The files are searched, not parsed: reading the poses reports damaged files.
    """
    texts = (path.read_bytes() for path in folder.glob("*.xml") if path.is_file())
    return sorted({int(found) for text in texts for found in OBJECT_ID.findall(text)})


def read_poses(annotation: Path, meta: Path) -> list[ObjectPose]:
    """Read a frame's poses from its XML, with the digits of its `.mat` if the files agree.

    Poses are matched by object id, as the order of the files may differ.
    """
    rounded = read_annotation_xml(annotation)
    if not meta.is_file():
        return rounded
    stored = read_meta(meta)
    exact = dict(zip(stored.object_ids, () if stored.poses is None else stored.poses, strict=False))
    if sorted(stored.object_ids) != sorted(exact) or exact.keys() != {p.object_id for p in rounded}:
        log.info("%s lists other objects than %s; poses are the XML's", meta, annotation.name)
        return rounded
    difference = [np.abs(pose.T_cam_obj - exact[pose.object_id]).max() for pose in rounded]
    if not np.max(difference, initial=0.0) <= LARGEST_ROUNDING:  # `max` would pass over nan
        log.warning("%s holds other poses than %s; the XML's are taken", meta, annotation.name)
        return rounded
    return [ObjectPose(pose.object_id, exact[pose.object_id], pose.name) for pose in rounded]


def write_meta(path: Path, poses: Sequence[ObjectPose], intrinsic_matrix: Floats) -> None:
    """Write `meta/NNNN.mat` (YCB-Video style); same content, same bytes."""
    stacked = np.zeros((3, 4, len(poses)), dtype=np.float32)
    for index, pose in enumerate(poses):
        stacked[:, :, index] = pose.T_cam_obj[:3]
    content = {
        "poses": stacked,
        "intrinsic_matrix": np.asarray(intrinsic_matrix, dtype=np.float64),
        "factor_depth": np.array([[1000.0]]),
        "cls_indexes": np.array([[pose.object_id + 1 for pose in poses]], dtype=np.int64),
    }
    from scipy.io import savemat  # noqa: PLC0415 - slow to import, and few commands write

    buffer = io.BytesIO()
    savemat(buffer, content, do_compression=True)  # type: ignore[arg-type]
    write_bytes(path, MAT_TEXT + buffer.getvalue()[len(MAT_TEXT) :])


def read_meta(path: Path) -> FrameMeta:
    """Read `meta/NNNN.mat` or a demo folder's `meta.mat`; poses may be missing.

    Rotations that are a little off are made exact.
    """
    content = read_mat(path)
    for name in ("intrinsic_matrix", "factor_depth"):
        if name not in content:
            raise FormatError(
                path, f"lacks `{name}`", "intrinsic_matrix and factor_depth are needed"
            )
    matrix = np.asarray(content["intrinsic_matrix"], dtype=np.float64)
    if matrix.shape != (3, 3):
        raise FormatError(path, f"intrinsic_matrix is {matrix.shape}", "(3, 3) is expected")
    (factor,) = content["factor_depth"].ravel()[:1] if content["factor_depth"].size else (np.nan,)
    ids = np.asarray(content.get("cls_indexes", np.zeros(0)), dtype=np.int64).ravel() - 1
    return FrameMeta(
        intrinsic_matrix=matrix,
        factor_depth=float(factor),
        object_ids=tuple(int(i) for i in ids),
        poses=_read_mat_poses(path, content.get("poses"), len(ids)),
    )


def write_object_ids(path: Path, object_ids: Sequence[int]) -> None:
    """Write `object_id_list.txt`: one 0-indexed id a line."""
    write_text(path, "".join(f"{object_id}\n" for object_id in object_ids))


def read_object_ids(path: Path) -> list[int]:
    """Read `object_id_list.txt`.

    Raises:
        FormatError: a line is no number of at most nine digits.
    """
    lines = read_text(path).split()
    if not all(line.isdecimal() and len(line) < 10 for line in lines):
        raise FormatError(path, "a line that is no object id", "one integer a line, from 0")
    return [int(line) for line in lines]


def write_pose_array(path: Path, poses: Floats) -> None:
    """Write camera_poses.npy (n, 4, 4), rs_wrt_kn.npy (n, 4, 4) or cam0_wrt_table.npy (4, 4)."""
    write_npy(path, np.asarray(poses, dtype=np.float64))


def read_pose_array(path: Path, ndim: int) -> Array:
    """Read a file of `write_pose_array`: float64 of `ndim` dimensions, (4, 4) or (n, 4, 4).

    Rotations that are inexact because of few decimals are made exact.

    Raises:
        FormatError: another shape, or matrices that are no rigid transforms.
    """
    poses = read_npy(path)
    if poses.shape[-2:] != (4, 4) or poses.ndim != ndim:
        expected = f"{'(4, 4)' if ndim == 2 else '(n, 4, 4)'} is expected"
        raise FormatError(path, f"an array of shape {poses.shape}", expected)
    if poses.dtype.kind not in "fiu" or not _are_rigid(poses):
        raise FormatError(path, "a matrix is no rigid transform", "rotations are orthonormal")
    return _straightened(poses.astype(np.float64))


def _straightened(poses: Array) -> Array:
    """Return `poses` (..., 4, 4) with rounded rotations made exact.

    Rotations exact in single precision, and matrices that are no rotations, stay unchanged.
    """
    R = poses[..., :3, :3]
    with np.errstate(invalid="ignore"):  # from infinity, which gives nan: every comparison fails
        misfit = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(axis=(-2, -1))
    off = (misfit > EXACT_TOLERANCE) & (misfit <= RIGID_TOLERANCE)
    if off.any():
        poses = poses.copy()
        poses[off, :3, :3] = nearest_orthogonal(R[off])
    return poses


def _are_rigid(poses: NDArray[Any]) -> bool:
    """Return whether all `poses` (..., 4, 4) are rigid, except for rounding; False for nan."""
    R, last = poses[..., :3, :3].astype(np.float64), poses[..., 3, :]
    misfit = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(initial=0.0)
    misfit = max(misfit, np.abs(last - np.array([0.0, 0.0, 0.0, 1.0])).max(initial=0.0))
    right_handed = bool((np.linalg.det(R) > 0.0).all())
    return bool(misfit <= RIGID_TOLERANCE) and right_handed and bool(np.isfinite(poses).all())


def _four(values: Floats) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def _read_object(path: Path, element: ElementTree.Element) -> ObjectPose:
    texts = {child.tag: (child.text or "").strip() for child in element}
    missing = [field for field in NEEDED_FIELDS if field not in texts]
    if missing:
        found = f"<{element.tag}> lacks {', '.join(missing)}"
        raise FormatError(path, found, f"an object has {', '.join(POSE_FIELDS)}")
    try:
        position = np.array(texts["pos_in_world"].split(), dtype=np.float64).reshape(3)
        quaternion = np.array(texts["ori_in_world"].split(), dtype=np.float64).reshape(4)
        object_id = int(texts["obj_id"])
    except ValueError as error:
        raise FormatError(
            path, f"an object's pose is not numeric ({error})", "id, 3 metres, 4 of a quaternion"
        ) from error
    length = float(np.linalg.norm(quaternion))
    # Written so that nan fails too.
    if not (abs(length - 1.0) <= RIGID_TOLERANCE and np.isfinite(position).all()):
        found = f"the pose of object {object_id} is no rigid transform"
        raise FormatError(path, found, "3 finite metres, a quaternion of length 1")
    pose = make_pose(quaternion_to_matrix(quaternion), position)
    return ObjectPose(object_id, pose, texts.get("obj_name", "").removesuffix(".ply"))


def _read_mat_poses(path: Path, stored: NDArray[Any] | None, count: int) -> Array | None:
    if stored is None:
        return None
    poses = np.asarray(stored, dtype=np.float64)
    if count == 0:
        return np.zeros((0, 4, 4))
    poses = poses.reshape((3, 4, 1)) if poses.shape == (3, 4) else poses
    if poses.shape != (3, 4, count):
        raise FormatError(path, f"poses are {poses.shape}", f"(3, 4, {count}) is expected")
    full = np.tile(np.eye(4), (count, 1, 1))
    full[:, :3] = np.moveaxis(poses, 2, 0)
    return _straightened(full)
