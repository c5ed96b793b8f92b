"""Mutations of numpy's files: other shapes, types, headers and members, and bombs."""

import io
import random
import struct
import zipfile
from typing import Any

import numpy as np

HUGE = ((2**31,), (10**6, 10**6), (2**62,), (10**9, 3))
MAGIC = b"\x93NUMPY\x01\x00"


def npy_bytes(array: np.ndarray[Any, Any]) -> bytes:
    """Return `array` as the bytes of a .npy file."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def npy_array(data: bytes, rng: random.Random) -> bytes:
    """Return a .npy of another shape, type or content, or with a wrong header."""
    array = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    kinds = ("i1", "u8", "c16", "f2", "U3", "S2", "?", "M8[s]")
    lies = ("<U500000000", "|V1000000000", "O", "x", "[('a','<f8')]")
    with np.errstate(all="ignore"):
        ways = (
            lambda: npy_bytes(array.astype(rng.choice(kinds))),
            lambda: npy_bytes(array.reshape(-1)[: rng.randrange(array.size + 1)]),
            lambda: npy_bytes(np.asarray(rng.choice((0, np.nan, 1e300, "x", b"x")))),
            lambda: npy_bytes(array[None]),
            lambda: npy_bytes(array[..., None]),
            lambda: _lying(str(array.dtype.str), rng.choice(HUGE)) + data[128:],
            lambda: npy_bytes(np.array([{"a": 1}], object)),
            lambda: _lying(rng.choice(lies), (1,)) + data[128:],
            lambda: _odd_number(array, rng),
            lambda: npy_bytes(np.array([(1, 2.0)], [("a", "i4"), ("b", "f8")])),
        )
        return rng.choice(ways)()


def _odd_number(array: np.ndarray[Any, Any], rng: random.Random) -> bytes:
    odd = np.asarray(rng.choice((np.nan, np.inf, -1, 1e30, 0, 2**31)))
    changed = np.array(array).reshape(-1)
    if changed.size:
        changed[rng.randrange(changed.size)] = odd.astype(changed.dtype)
    return npy_bytes(changed.reshape(array.shape))


def _lying(kind: str, shape: tuple[int, ...]) -> bytes:
    described = kind if kind.startswith("[") else repr(kind)
    head = f"{{'descr': {described}, 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    head += b" " * (117 - len(head)) + b"\n"
    return MAGIC + struct.pack("<H", len(head)) + head


def npz_member(data: bytes, rng: random.Random) -> bytes:
    """Return an .npz with one member changed, missing, twice, or a bomb."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = sorted(members)
    at = rng.choice(names)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as made:
        kind = rng.randrange(8)
        for name in names:
            if kind == 0 and name == at:
                continue
            if kind == 1 and name == at:
                array = np.lib.format.read_array(io.BytesIO(members[name]))
                shape = (3 * 2**28 // max(1, array.dtype.itemsize),)
                head = _lying(array.dtype.str, shape)
                with made.open(name, "w") as stream:
                    stream.write(head)
                    for _ in range(3 * 2**28 >> 20):
                        stream.write(bytes(1 << 20))
                continue
            content = npy_array(members[name], rng) if name == at else members[name]
            made.writestr("x.npy" if kind == 2 and name == at else name, content)
            if kind == 3 and name == at:
                made.writestr("notes.txt", b"hello")
    return buffer.getvalue()
