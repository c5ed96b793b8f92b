"""Grasp labels in parts: a label of gigabytes is made for some points at a time, then joined.

A part is a label file of consecutive points. Joining copies one array of one part at a time, so its
memory is that of a part, however large the label.
"""

import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pipelines.dataset.graspnet.graspnet_labels import LABEL_ARRAYS
from pipelines.errors import FormatError
from pipelines.storage.files import atomic_path, existing


def join_grasp_labels(path: Path, parts: Sequence[Path], *, compress: bool = False) -> None:
    """Write `grasp_label/NNN_labels.npz` from its `parts`, in their order.

    Uncompressed, as the original is published; `compress` makes it about fifteen times smaller.
    """
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name in LABEL_ARRAYS:
            # `ZipInfo` has a fixed date, so that the same label has the same bytes.
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = method
            with archive.open(member, "w", force_zip64=True) as stream:
                _write_joined(stream, parts, name)


def part_arrays(parts: Sequence[Path], name: str) -> Iterator[NDArray[Any]]:
    """Yield the array `name` of each of `parts`, reading no other array.

    Raises:
        FormatError: a part is no whole label file.
    """
    for part in parts:
        try:
            with existing(part).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                array = arrays[name]
        except (ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
            found = f"this part of a grasp label is damaged ({error})"
            raise FormatError(part, found, "delete it and run label-grasps again") from error
        yield array


def _write_joined(stream: IO[bytes], parts: Sequence[Path], name: str) -> None:
    num_points = sum(len(points) for points in part_arrays(parts, "points"))
    for number, array in enumerate(part_arrays(parts, name)):
        if number == 0:
            header = {
                "descr": np.lib.format.dtype_to_descr(array.dtype),
                "fortran_order": False,
                "shape": (num_points, *array.shape[1:]),
            }
            np.lib.format.write_array_header_1_0(stream, header)
        stream.write(np.ascontiguousarray(array).data)
