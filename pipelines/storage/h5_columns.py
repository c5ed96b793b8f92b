"""Columns of HDF5 files: named arrays of equal first axis, with their units as attributes.

A file of many small columns is written and read through h5py's functions for HDF5's own handles:
h5py's objects for groups, datasets and attributes take several times longer than HDF5 does.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import Field, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t
from numpy.typing import DTypeLike, NDArray

from pipelines.contents import json_object, reading, reason
from pipelines.errors import FormatError, ValueRangeError

Column = NDArray[Any] | Sequence[str]
Handle = Any  # h5py's `id` of a file, group or dataset, or a type
ColumnSpec = Mapping[str, tuple[tuple[int, ...], type]]  # shape after the first axis, type
COLUMN = "column"  # in the metadata of a field
NUMBERS = "biuf"  # kinds of numpy's types
TEXT = h5py.string_dtype("utf-8")
SCALAR = h5s.create(h5s.SCALAR)
UNDATED = h5p.create(h5p.DATASET_CREATE)
UNDATED.set_obj_track_times(False)


def write_columns(
    group: h5py.Group,
    columns: Mapping[str, Column],
    units: Mapping[str, str] | None = None,
    by_row: Collection[str] = (),
) -> None:
    """Write `columns` as datasets of `group`, in order, with the attribute `units` where given.

    Columns in `by_row` are stored a row per chunk, to be read in any order. Dates are not stored
    (`track_times`): the same columns give the same bytes.
    """
    for name, column in columns.items():
        if not isinstance(column, np.ndarray) or column.dtype.kind in "UOS":
            texts = np.array([str(text) for text in column], dtype=object)
            made = _write_column(group.id, name, texts)
        elif name in by_row and len(column):
            chunks = (1, *column.shape[1:])
            made = group.create_dataset(name, data=column, chunks=chunks, track_times=False).id
        else:
            made = _write_column(group.id, name, np.asarray(column, order="C"))
        if units and name in units:
            write_attribute(made, "units", units[name])


def make_column(
    group: h5py.Group, name: str, shape: tuple[int, ...], dtype: DTypeLike, unit: str | None
) -> None:
    """Make a dataset of `group`, to be filled; the type `object` is for texts."""
    made = _make(group.id, name, shape, _types(np.dtype(dtype))[0])
    if unit:
        write_attribute(made, "units", unit)


def write_attribute(owner: Handle, name: str, value: str | int) -> None:
    """Write a new attribute; `owner` is the `id` of a file, group or dataset."""
    content = np.array(value, dtype=object) if isinstance(value, str) else np.asarray(value)
    stored, in_memory = _types(content.dtype)
    h5a.create(owner, name.encode(), stored, SCALAR).write(content, in_memory)


def _write_column(group: Handle, name: str, column: NDArray[Any]) -> Handle:
    stored, in_memory = _types(column.dtype)
    dataset = _make(group, name, column.shape, stored)
    dataset.write(h5s.ALL, h5s.ALL, column, in_memory)
    return dataset


def _make(group: Handle, name: str, shape: tuple[int, ...], stored: Handle) -> Handle:
    return h5d.create(group, name.encode(), stored, h5s.create_simple(shape), UNDATED)


@lru_cache
def _types(dtype: np.dtype[Any]) -> tuple[Handle, Handle]:
    """Return HDF5's types for arrays of numpy's `dtype`, in a file and in memory."""
    named = TEXT if dtype.kind == "O" else dtype
    return h5t.py_create(named, logical=True), h5t.py_create(named)


def read_columns(path: Path, group: h5py.Group, names: Iterable[str]) -> dict[str, Any]:
    """Read datasets of `group`: arrays, and texts as arrays of str objects.

    If `names` is a ColumnSpec, all datasets must have its shapes and the same number of rows.

    Raises:
        FormatError: one of `names` is missing or damaged.
    """
    datasets = {name: group.get(name) for name in names}
    for name, dataset in datasets.items():
        if not isinstance(dataset, h5py.Dataset):
            raise FormatError(path, f"has no dataset {group.name}/{name}", "write the file again")
    if isinstance(names, Mapping):
        _check_shapes(path, datasets, names)
    columns: dict[str, Any] = {}
    for name, dataset in datasets.items():
        with reading(path, f"{group.name}/{name}", "write the file again"):
            columns[name] = read_rows(dataset, slice(None))
    return columns


def _check_shapes(path: Path, datasets: Mapping[str, h5py.Dataset], spec: ColumnSpec) -> None:
    rows = min((each.shape[0] for each in datasets.values() if each.shape), default=0)
    for name, (trailing, _type) in spec.items():
        if datasets[name].shape != (rows, *trailing):
            found = f"{datasets[name].name} has the shape {datasets[name].shape}"
            raise FormatError(path, found, f"{(rows, *trailing)} is expected; write the file again")


def read_rows(dataset: h5py.Dataset, rows: slice) -> NDArray[Any]:
    """Read rows of a dataset of numbers or texts, the latter as str objects.

    Raises:
        ValueError: the dataset has no rows, or values of another type.
        OSError: HDF5 cannot read the dataset.
    """
    is_text = h5py.check_string_dtype(dataset.dtype) is not None
    if not dataset.shape or (dataset.dtype.kind not in NUMBERS and not is_text):
        raise ValueError(f"{dataset.dtype} of shape {dataset.shape} is no column")
    found: NDArray[Any] = dataset.asstr()[rows] if is_text else dataset[rows]
    return found


def json_attributes(path: Path, file: h5py.File, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the JSON objects in attributes; empty if there is no such attribute.

    Raises:
        FormatError: an attribute holds something else.
    """
    return {name: json_object(path, attribute(file, name, "{}"), name) for name in names}


def attribute(file: h5py.File, name: str, default: Any = None) -> Any:  # noqa: ANN401 - HDF5's
    """Return an attribute of a file: `default` if it is missing, None if it cannot be read."""
    try:
        return file.attrs.get(name, default)
    except (OSError, TypeError, ValueError, UnicodeDecodeError):
        return None


def read_alike(group: Handle, examples: Mapping[str, NDArray[Any]]) -> dict[str, Any] | None:
    """Read the datasets of `group` if each has the type and row shape of its example, else None.

    `read_columns` reads other datasets or raises a FormatError. Datasets that HDF5 cannot read, and
    texts that are not UTF-8, raise one of `files.DAMAGED`.
    """
    columns: dict[str, Any] = {}
    for name, example in examples.items():
        dataset = h5d.open(group, name.encode())
        stored, in_memory = _types(example.dtype)
        shape = dataset.shape
        if len(shape) != example.ndim or shape[1:] != example.shape[1:]:
            return None
        if not dataset.get_type().equal(stored):
            return None
        column = np.zeros(shape, example.dtype)
        dataset.read(h5s.ALL, h5s.ALL, column, in_memory)
        if column.dtype == object:
            column[:] = [text.decode() for text in column]
        columns[name] = column
    return columns


def check_version(
    path: Path,
    found: Any,  # noqa: ANN401 - any attribute
    known: int,
    oldest: int | None = None,
) -> None:
    """Raise FormatError unless `found` is a format version that this code knows.

    Known are the versions from `oldest` to `known`; without `oldest`, `known` alone.
    """
    first = known if oldest is None else oldest
    try:
        is_known = first <= int(found) <= known
    except (OverflowError, TypeError, ValueError):  # no number, or none at all
        is_known = False
    if not is_known:
        versions = f"{known}" if first == known else f"{first} to {known}"
        shown = reason(ValueError(found))
        raise FormatError(path, f"has format_version {shown}", f"this symgrasp reads {versions}")


def table_column(shape: tuple[int, ...], dtype: type, *, optional: bool = False) -> Any:  # noqa: ANN401
    """Declare a column as a field of a `ColumnTable`: its shape after the first axis, and its type.

    `optional`: the column has no rows if it is not given.
    """
    if optional:
        return field(default_factory=lambda: np.zeros(0), metadata={COLUMN: (shape, dtype)})
    return field(metadata={COLUMN: (shape, dtype)})


class ColumnTable:
    """Columns of equal length, a dataclass whose fields are declared by `table_column`."""

    SPEC: ClassVar[ColumnSpec]

    def __init_subclass__(cls) -> None:
        declared = {name: each for name, each in vars(cls).items() if isinstance(each, Field)}
        cls.SPEC = {n: f.metadata[COLUMN] for n, f in declared.items() if COLUMN in f.metadata}


def coerce_columns(table: object, spec: ColumnSpec, length: int) -> None:
    """Set the attributes of a frozen `table` named by `spec` to arrays of its shapes and types.

    Args:
        table: a dataclass instance, in its `__post_init__`.
        spec: attribute to (shape after the first axis, type).
        length: length of the first axis of every column.

    Raises:
        ValueRangeError: a column has another shape or type.
    """
    for name, (trailing, dtype) in spec.items():
        given, owner = getattr(table, name), type(table).__name__
        try:
            array: NDArray[Any] = np.asarray(given, dtype=dtype)
        except (OverflowError, TypeError, ValueError) as error:
            found, expected = f"of another type ({error})", f"of type {np.dtype(dtype)}"
            raise ValueRangeError(f"{owner}.{name}", found, expected) from error
        if array.size == 0 and length == 0:
            array = array.reshape(0, *trailing)
        if array.shape != (length, *trailing):
            expected = f"of shape {(length, *trailing)}"
            raise ValueRangeError(f"{owner}.{name}", array.shape, expected)
        if array.dtype == object and not all(isinstance(each, str) for each in array.flat):
            raise ValueRangeError(f"{owner}.{name}", "of another type", "texts")
        object.__setattr__(table, name, array)
