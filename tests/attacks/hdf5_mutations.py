"""Mutations of HDF5 files: odd attributes and datasets, links that lead outside, wrong sizes."""

import io
import os
import random
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pipelines.storage import h5_files


def mutated(data: bytes, path: Path, rng: random.Random) -> str:
    """Write the HDF5 file `data` to `path` with one change; return the change in words."""
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        kind = rng.choice((_attribute, _attribute, _dataset, _dataset, _outside))
        done = kind(file, names, path, rng)
    content = buffer.getvalue()
    path.write_bytes(content)
    if rng.random() < 0.7:  # with the right check sum
        check_sum = h5_files._check_sum(path, len(content))
        with path.open("ab") as stream:
            stream.write(h5_files.SEAL.pack(h5_files.MARK, len(content), check_sum))
    return done


def _attribute(file: h5py.File, names: list[str], _path: Path, rng: random.Random) -> str:
    from tests.attacks.mutations import DEEP, ODD_TEXTS, json_value

    name = rng.choice(sorted(file.attrs))
    stored = file.attrs[name]
    if isinstance(stored, str) and stored.startswith("{") and rng.random() < 0.6:
        file.attrs[name] = json_value(stored.encode(), rng).decode()
        return f"{name}: JSON with an odd value"
    odd: list[Any] = [
        *(0, -1, 1e300, np.nan, [1, 2, 3], np.zeros((2, 2)), np.array([], "f4"), b"\xff\xfe", True),
        *(*ODD_TEXTS[:5], "[1]", "3", "null", '"x"', "[" * DEEP + "]" * DEEP, "{", '{"a":' * DEEP),
        *(h5py.Empty("f4"), h5py.Empty(h5py.string_dtype()), ["a", "b"], file.ref, np.void(b"abc")),
        np.array([(1, 2.0)], [("a", "i4"), ("b", "f8")]),
    ]  # fmt: skip
    del file.attrs[name]
    if rng.random() < 0.85:
        value = rng.choice(odd)
        file.attrs[name] = value
        return f"{name} = {str(value)[:40]!r}"
    return f"{name} is gone"


def _dataset(file: h5py.File, names: list[str], _path: Path, rng: random.Random) -> str:
    name = rng.choice([n for n in names if isinstance(file[n], h5py.Dataset)])
    stored = file[name]
    shape, dtype = stored.shape, stored.dtype
    value = stored[()]
    if rng.random() < 0.1 and np.issubdtype(dtype, np.number) and stored.size:
        flat = np.array(value).reshape(-1)
        with np.errstate(all="ignore"):
            odd = np.asarray(rng.choice((-1, 0, 2**31 - 1, 1e30, np.nan, np.inf, 255)))
            flat[rng.randrange(flat.size)] = odd.astype(dtype)
        stored[...] = flat.reshape(shape)
        return f"{name}: an odd number"
    del file[name]
    others = {
        "shorter": {"data": value[:-1] if shape and shape[0] else 0},
        "a scalar": {"data": 1.0},
        "huge": {"shape": (10**9, *shape[1:]), "dtype": dtype, "chunks": True, "compression": 1},
        "long": {"shape": (4 * 10**7, *shape[1:]), "dtype": "u1", "chunks": True, "fillvalue": 1},
        "texts": {"shape": shape, "dtype": h5py.string_dtype() if dtype.kind != "O" else "f4"},
        "empty": {"data": h5py.Empty("f4")},
        "of fields": {"shape": shape, "dtype": np.dtype([("a", "i4"), ("b", "f8")])},
        "an axis more": {"shape": (*shape, 2), "dtype": "f4"},
        "an axis before": {"shape": (1, *shape), "dtype": "f8"},
        "long texts": {"shape": shape, "dtype": "S200000"},
        "gone": {},
        "a group": {},
    }
    done = rng.choice(sorted(others))
    if done == "a group":
        file.create_group(name)
    elif done != "gone":
        file.create_dataset(name, **others[done])
    return f"{name}: {done}"


def _outside(file: h5py.File, names: list[str], path: Path, rng: random.Random) -> str:
    name = rng.choice(names)
    stored = file[name]
    is_dataset = isinstance(stored, h5py.Dataset)
    shape = stored.shape if is_dataset else (10,)
    dtype = stored.dtype if is_dataset and stored.dtype.kind != "O" else np.dtype("f4")
    del file[name]
    pipe = path.with_name("pipe")
    if not pipe.exists():
        os.mkfifo(pipe)
    choice = rng.randrange(8)
    target = rng.choice((str(pipe), "/etc/passwd", path.name, "/dev/zero"))
    match choice:
        case 0 | 1:
            file[name] = h5py.ExternalLink(target, name)
        case 2 | 3:
            file.create_dataset(name, shape, dtype, external=[(target, 0, h5py.h5f.UNLIMITED)])
        case 4 | 5:
            layout = h5py.VirtualLayout(shape or (1,), dtype)
            source = h5py.VirtualSource(target, name, shape or (1,))
            layout[...] = source
            file.create_virtual_dataset(name, layout)
        case 6:
            file[name] = h5py.SoftLink(f"/{name}")
        case _:
            file[name] = h5py.SoftLink("/")
    return f"{name}: leads outside, way {choice}, {target}"
