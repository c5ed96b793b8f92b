"""Columns of HDF5 files, against files written by h5py's objects."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from pipelines.storage.h5_columns import TEXT, read_alike, write_attribute, write_columns

COLUMNS: dict[str, Any] = {
    "half": np.zeros((3, 4), np.float16),
    "big": np.arange(10, dtype=">i4"),
    "strided": np.arange(20)[::3],
    "fortran": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
    "flags": np.array([True, False, True]),
    "none": np.zeros((0, 3), np.float32),
    "texts": ["x", "", "é"],
    "objects": np.array(["y"], dtype=object),
    "no texts": [],
}


def test_columns_have_the_bytes_that_h5py_writes(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "found.h5", "w") as file:
        write_attribute(file.id, "note", "ü")
        write_attribute(file.id, "seed", 3)
        write_columns(file.create_group("g"), COLUMNS, {"half": "m", "texts": "s"})
    with h5py.File(tmp_path / "expected.h5", "w") as file:
        file.attrs["note"] = "ü"
        file.attrs["seed"] = 3
        group = file.create_group("g")
        for name, column in COLUMNS.items():
            is_text = not isinstance(column, np.ndarray) or column.dtype == object
            data = np.array(column, dtype=object) if is_text else column
            dtype = TEXT if is_text else None
            made = group.create_dataset(name, data=data, dtype=dtype, track_times=False)
            if name in ("half", "texts"):
                made.attrs["units"] = {"half": "m", "texts": "s"}[name]
    found, expected = (tmp_path / f"{name}.h5" for name in ("found", "expected"))
    assert found.read_bytes() == expected.read_bytes()


def test_columns_of_the_same_layout_are_read_and_others_are_not(tmp_path: Path) -> None:
    columns = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "t": np.array(["é", "b"], object)}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write_columns(file, columns)
        found = read_alike(file.id, {"a": np.zeros((0, 3), np.float32), "t": np.zeros(0, object)})
        assert found is not None
        for name, column in columns.items():
            assert found[name].tolist() == column.tolist()
            assert found[name].dtype == column.dtype
        for other in (
            {"a": np.zeros((0, 3), np.float64)},
            {"a": np.zeros((0, 2), np.float32)},
            {"a": np.zeros(0, np.float32)},
            {"t": np.zeros(0, np.int32)},
            {"a": np.zeros((0, 3), object)},
        ):
            assert read_alike(file.id, other) is None
        with pytest.raises(KeyError):
            read_alike(file.id, {"b": np.zeros(0)})
