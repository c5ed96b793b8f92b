"""Columns of HDF5 files: named arrays of equal first axis, with their units beside them."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, ValueRangeError

Column = NDArray[Any] | Sequence[str]
ColumnSpec = Mapping[str, tuple[tuple[int, ...], type]]  # shape after the first axis, type
TEXT = h5py.string_dtype("utf-8")


def write_columns(
    group: h5py.Group,
    columns: Mapping[str, Column],
    units: Mapping[str, str] | None = None,
    by_row: Collection[str] = (),
) -> None:
    """Write `columns` as datasets of `group`, in order, with the attribute `units` where given.

    Those named in `by_row` are stored a row a chunk, to be read in any order. Dates are not stored
    (`track_times`): the same columns give the same bytes.
    """
    for name, column in columns.items():
        if isinstance(column, np.ndarray) and column.dtype.kind not in "UOS":
            chunks = (1, *column.shape[1:]) if name in by_row and len(column) else None
            dataset = group.create_dataset(name, data=column, chunks=chunks, track_times=False)
        else:
            texts = np.array([str(text) for text in column], dtype=object)
            dataset = group.create_dataset(name, data=texts, dtype=TEXT, track_times=False)
        if units and name in units:
            dataset.attrs["units"] = units[name]


def read_columns(path: Path, group: h5py.Group, names: Iterable[str]) -> dict[str, Any]:
    """Read datasets of `group`: arrays, and texts as arrays of str objects.

    Raises:
        FormatError: one of `names` is missing or damaged.
    """
    columns: dict[str, Any] = {}
    for name in names:
        dataset = group.get(name)
        if not isinstance(dataset, h5py.Dataset):
            raise FormatError(path, f"has no dataset {group.name}/{name}", "write the file again")
        try:
            text = h5py.check_string_dtype(dataset.dtype) is not None
            columns[name] = dataset.asstr()[()] if text else dataset[()]
        except OSError as error:
            raise FormatError(
                path, f"{group.name}/{name} is damaged ({error})", "write the file again"
            ) from error
    return columns


def check_version(path: Path, found: Any, known: int) -> None:  # noqa: ANN401 - any attribute
    """Raise FormatError unless `found` is the format version that this code knows."""
    if found is None or int(found) != known:
        raise FormatError(path, f"has format_version {found}", f"this symgrasp reads {known}")


def coerce_columns(table: object, spec: ColumnSpec, length: int) -> None:
    """Set the attributes of a frozen `table` named by `spec` to arrays of its shapes and types.

    Args:
        table: a dataclass instance, in its `__post_init__`.
        spec: attribute to (shape after the first axis, type).
        length: of the first axis of every column.

    Raises:
        ValueRangeError: a column has another shape.
    """
    for name, (trailing, dtype) in spec.items():
        array: NDArray[Any] = np.asarray(getattr(table, name), dtype=dtype)
        if array.size == 0 and length == 0:
            array = array.reshape(0, *trailing)
        if array.shape != (length, *trailing):
            raise ValueRangeError(
                f"{type(table).__name__}.{name}", array.shape, f"of shape {(length, *trailing)}"
            )
        object.__setattr__(table, name, array)
