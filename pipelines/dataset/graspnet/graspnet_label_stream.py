"""Reader of `grasp_label/NNN_labels.npz`, whole or a few grasp points at a time.

An object of GraspNet-1Billion has up to 3,500 points with 14,400 candidates each, 0.85 GB. The
members of the archive, stored or deflated, are unpacked in step, so that memory holds one piece.
The size of each member follows from the shape of `points`; an archive that declares another size is
refused before it is unpacked. Pickled objects are never read.
"""

import math
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from pipelines.array_types import Singles
from pipelines.configs.dataset import MAX_LABEL_POINTS
from pipelines.dataset.graspnet.graspnet_labels import LABEL_ARRAYS, LABEL_GRID, GraspLabel
from pipelines.errors import FormatError
from pipelines.storage.files import existing

MAX_DEFLATE_RATIO = 1040  # deflate packs at most 1032 bytes into one
READ_BYTES = 2**18  # per read: only small reads unpack a zip member in linear time
KINDS = {"points": "f", "offsets": "f", "collision": "bui", "scores": "f"}  # numpy's dtype kinds
HEADERS = {(1, 0): npy_format.read_array_header_1_0, (2, 0): npy_format.read_array_header_2_0}
DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, OSError, RuntimeError)


@dataclass(frozen=True)
class _Member:
    """An array of the archive, with its stream at the first number."""

    name: str
    stream: IO[bytes]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def read(self, rows: int) -> NDArray[Any]:
        """Return the next `rows` of the array's first axis."""
        array = np.zeros((rows, *self.shape[1:]), self.dtype)
        view, done = array.reshape(-1).view(np.uint8).data, 0
        while done < len(view):
            data = self.stream.read(min(READ_BYTES, len(view) - done))
            if not data:
                raise EOFError(f"{self.name} ends early")
            view[done : done + len(data)] = data
            done += len(data)
        return array


def read_grasp_label(path: Path) -> GraspLabel:
    """Read a whole label; 17 bytes for each of its P * 14400 candidates."""
    whole = next(grasp_label_pieces(path, MAX_LABEL_POINTS), None)
    if whole is None:
        raise FormatError(path, "holds no grasp points", "label the object again")
    return whole


def grasp_label_pieces(path: Path, num_points: int) -> Iterator[GraspLabel]:
    """Yield the label of `path` by `num_points` grasp points at a time, in file order.

    Raises:
        FormatError: the file is truncated, pickled or a zip bomb; arrays are missing or misshaped.
            Damage in the middle is found when reading reaches it.
    """
    with ExitStack() as stack:
        try:
            archive = stack.enter_context(zipfile.ZipFile(existing(path)))
            members = _opened(path, archive, stack)
            stored = members.pop("points")
            points = stored.read(stored.shape[0])
        except DAMAGE as error:
            raise _damaged(path, error) from error
        points = points.astype(np.float32)
        if not np.isfinite(points).all():
            raise FormatError(path, "points are not all finite", "metres, object frame")
        for start in range(0, len(points), num_points):
            piece = points[start : start + num_points]
            try:
                arrays = {name: member.read(len(piece)) for name, member in members.items()}
            except DAMAGE as error:
                raise _damaged(path, error) from error
            yield _label(path, piece, arrays)


def _label(path: Path, points: Singles, arrays: dict[str, NDArray[Any]]) -> GraspLabel:
    scores = arrays["scores"].astype(np.float32, copy=False)
    offsets = arrays["offsets"].astype(np.float32, copy=False)
    if not np.isfinite(offsets[scores > 0]).all():
        raise FormatError(
            path, "offsets of grasps that hold are not all finite", "angle, depth, width"
        )
    return GraspLabel(points, offsets, arrays["collision"].astype(bool, copy=False), scores)


def _opened(path: Path, archive: zipfile.ZipFile, stack: ExitStack) -> dict[str, _Member]:
    held = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
    missing = [name for name in LABEL_ARRAYS if name not in held]
    if missing:
        raise FormatError(
            path, f"lacks the arrays {', '.join(missing)}", f"it holds {', '.join(sorted(held))}"
        )
    members = {}
    for name in LABEL_ARRAYS:
        info = held[name]
        _refuse_bomb(path, info)
        stream = stack.enter_context(archive.open(info))
        members[name] = _member(path, name, stream, info.file_size)
        if name == "points":
            _check_points(path, members[name].shape)  # before any other member is opened
    shape = (*members["points"].shape[:1], *LABEL_GRID)
    for name, expected in (("offsets", (*shape, 3)), ("collision", shape), ("scores", shape)):
        if members[name].shape != expected:
            raise FormatError(
                path, f"{name} of shape {members[name].shape}", f"{expected} is expected"
            )
    return members


def _member(path: Path, name: str, stream: IO[bytes], declared: int) -> _Member:
    version = npy_format.read_magic(stream)
    if version not in HEADERS:
        raise FormatError(path, f"{name} is .npy version {version}", "1.0 or 2.0 is expected")
    shape, fortran_order, dtype = HEADERS[version](stream)
    if dtype.hasobject:
        raise FormatError(path, f"{name} holds Python objects", "pickles are never read")
    if dtype.kind not in KINDS[name] or (dtype.kind in "ui" and dtype.itemsize > 1):
        kind = "truth values" if name == "collision" else "floats"
        raise FormatError(path, f"{name} is of type {dtype}", f"{kind} are expected")
    if fortran_order and len(shape) > 1:
        raise FormatError(path, f"{name} is in Fortran's order", "C's order is expected")
    expected = stream.tell() + math.prod(shape) * dtype.itemsize
    if declared != expected:
        raise FormatError(
            path,
            f"{name} unpacks to {declared} bytes",
            f"its shape {shape} of {dtype} takes {expected}",
        )
    return _Member(name, stream, shape, dtype)


def _check_points(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or shape[1] != 3:
        raise FormatError(path, f"points of shape {shape}", "(P, 3) is expected")
    if shape[0] > MAX_LABEL_POINTS:
        raise FormatError(path, f"{shape[0]} points", f"at most {MAX_LABEL_POINTS} are read")


def _refuse_bomb(path: Path, info: zipfile.ZipInfo) -> None:
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FormatError(
            path,
            f"{info.filename} has compression method {info.compress_type}",
            "stored or deflated",
        )
    if info.file_size > MAX_DEFLATE_RATIO * (info.compress_size + 1):
        raise FormatError(
            path,
            f"{info.filename} claims to unpack from {info.compress_size} to {info.file_size} bytes",
            f"at most {MAX_DEFLATE_RATIO} times its size is possible",
        )


def _damaged(path: Path, error: Exception) -> FormatError:
    return FormatError(
        path,
        f"this is not a whole .npz file of numbers ({error})",
        "plain arrays are read, pickles never",
    )
