"""Numbers and plain containers from a pickle, without running any of its code.

The unpickler knows numpy's arrays, types and scalars by name and replaces them by its own classes,
which check and collect values; neither numpy's code nor any other receives the pickle's content.
All other names are refused. Used only for files that the user trusts (D. 53), by `--trust-pickle`.
"""

import io
import math
import pickle
import pickletools
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from pipelines.errors import FormatError
from pipelines.storage.array_files import DAMAGED, NPY_MAGIC
from pipelines.storage.files import existing

MAX_VALUES = 1_000_000  # Python objects in containers; arrays' numbers do not count
MAX_BYTES = 2**28  # read from a file; a longer pickle counts as damaged
MAX_DEPTH = 20  # of containers within containers
NUMBERS = re.compile(r"[biuf](?:1|2|4|8)")
EXPECTED = "numpy arrays of numbers in plain containers are read, nothing else"


def read_plain_pickle(path: Path) -> Any:  # noqa: ANN401 - whatever containers the file holds
    """Read a pickle, or a `.npy` that holds one: arrays, numbers, texts, lists, dicts.

    Raises:
        FormatError: the pickle is damaged, or asks for anything else.
    """
    with existing(path).open("rb") as stream:
        try:
            if stream.read(len(NPY_MAGIC)) == NPY_MAGIC:
                _skip_npy_head(stream)
            else:
                stream.seek(0)
            steps = _without_far_places(stream.read(MAX_BYTES))
            content = _PlainUnpickler(io.BytesIO(steps), encoding="latin1").load()
            return _plain(content, [MAX_VALUES], MAX_DEPTH)
        except (*DAMAGED, AttributeError, pickle.UnpicklingError) as error:
            raise FormatError(path, f"this pickle is not read ({error})", EXPECTED) from error


def _skip_npy_head(stream: BinaryIO) -> None:
    major, _minor = stream.read(2)
    size = int.from_bytes(stream.read(2 if major == 1 else 4), "little")
    stream.read(size)


def _without_far_places(steps: bytes) -> bytes:
    """Return the pickle `steps`, unless it stores an object at a place beyond its own length.

    The unpickler allocates memory up to that place: four bytes ask for 64 GB.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of texts with needless escapes
        for step, place, _ in pickletools.genops(steps):
            if step.name.endswith("PUT") and int(place or 0) > len(steps):
                raise pickle.UnpicklingError(f"it stores an object at place {place}")
    return steps


class _Replacement:
    """Replacement of a name that the pickle asks for: it may be called, and nothing else."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:  # noqa: ANN401 - the pickle's
        return self._function(*arguments)

    def __setstate__(self, _state: Any) -> None:  # noqa: ANN401 - the pickle's
        raise pickle.UnpicklingError("it changes an object that it asked for")


class _Type:
    """Replacement of numpy's dtype: numbers of 1 to 8 bytes, or the objects of a container."""

    __slots__ = ("code", "order")

    def __init__(self, code: str) -> None:
        self.code, self.order = code, "<"

    def __setstate__(self, state: Any) -> None:  # noqa: ANN401 - the pickle's
        if not (isinstance(state, tuple) and len(state) >= 5 and state[1] in ("<", ">", "|", "=")):
            raise pickle.UnpicklingError("a type that is none of numbers")
        if any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("a type of several fields")
        self.order = "<" if state[1] in ("|", "=") else state[1]

    @property
    def is_object(self) -> bool:
        return self.code == "O"

    def numpy(self) -> np.dtype[Any]:
        return np.dtype(self.order + self.code)


class _Array:
    """Replacement of numpy's array."""

    __slots__ = ("value",)

    def __init__(self) -> None:
        self.value: Any = None

    def __setstate__(self, state: Any) -> None:  # noqa: ANN401 - the pickle's
        if not (isinstance(state, tuple) and len(state) == 5):
            raise pickle.UnpicklingError("an array of an unknown form")
        _version, shape, kind, fortran, data = state
        self.value = _array(data, kind, shape, "F" if fortran else "C")


def _array(data: Any, kind: Any, shape: Any, order: str) -> Any:  # noqa: ANN401 - the pickle's
    """Return the array; for objects their list, or without dimensions the object itself."""
    if not isinstance(kind, _Type) or not isinstance(shape, tuple):
        raise pickle.UnpicklingError("an array without a type and a shape")
    if not all(isinstance(size, int) and size >= 0 for size in shape):
        raise pickle.UnpicklingError(f"an array of shape {shape!r}")
    if kind.is_object:
        if not isinstance(data, list) or len(data) != math.prod(shape):
            raise pickle.UnpicklingError("an array of objects that are not there")
        return data if shape else data[0]
    if isinstance(data, str):  # Python 2 did not distinguish texts from bytes
        data = data.encode("latin1")
    if not isinstance(data, bytes | bytearray):
        raise pickle.UnpicklingError("an array without its bytes")
    return np.frombuffer(bytes(data), kind.numpy()).reshape(
        shape, order="F" if order == "F" else "C"
    )


def _type(code: Any, *_flags: Any) -> _Type:  # noqa: ANN401 - the pickle's
    if isinstance(code, str) and code in ("O", "O4", "O8"):
        return _Type("O")
    if not isinstance(code, str) or NUMBERS.fullmatch(code) is None:
        raise pickle.UnpicklingError(f"values of the type {str(code)[:20]!r}")
    return _Type(code)


def _scalar(kind: Any, data: Any = b"") -> Any:  # noqa: ANN401 - the pickle's
    return _array(data, kind, (), "C").item()


def _reconstruct(*_arguments: Any) -> _Array:  # noqa: ANN401 - the pickle's
    return _Array()


def _from_buffer(data: Any, kind: Any, shape: Any, order: Any) -> _Array:  # noqa: ANN401 - the pickle's
    made = _Array()
    made.value = _array(data, kind, shape, str(order))
    return made


def _bytes(text: Any, encoding: Any = "latin1") -> bytes:  # noqa: ANN401 - the pickle's
    """Return bytes that Python 2 has written as a text."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError("a text in an unknown encoding")
    return text.encode("latin1")


def _no_array(*_arguments: Any) -> None:  # noqa: ANN401 - the pickle's
    raise pickle.UnpicklingError("an array made in an unknown way")


# All names that a pickle may ask for, and their replacements. numpy has moved its modules.
ALLOWED: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "dtype"): _type,
    ("numpy", "ndarray"): _no_array,  # named as an argument only
    ("_codecs", "encode"): _bytes,
}
for _core in ("numpy.core", "numpy._core"):
    for _module in ("multiarray", "_multiarray_umath"):
        ALLOWED[f"{_core}.{_module}", "_reconstruct"] = _reconstruct
        ALLOWED[f"{_core}.{_module}", "scalar"] = _scalar
    ALLOWED[f"{_core}.numeric", "_frombuffer"] = _from_buffer


class _PlainUnpickler(pickle.Unpickler):
    """Unpickler that knows the names of ALLOWED, and no others."""

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401 - as pickle has it
        """Return the replacement of a name."""
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}")
        return _Replacement(ALLOWED[module, name])

    def persistent_load(self, _identity: Any) -> Any:  # noqa: ANN401 - as pickle has it
        """Refuse a reference to an object outside of the pickle."""
        raise pickle.UnpicklingError("it refers to an object outside of it")


def _plain(value: Any, left: list[int], depth: int) -> Any:  # noqa: ANN401 - any content
    """Return containers with arrays in place of their replacements; circles are refused."""
    left[0] -= 1
    if left[0] < 0 or depth < 0:
        raise pickle.UnpicklingError("containers without end")
    if isinstance(value, _Array):
        inner = value.value
        return inner if isinstance(inner, np.ndarray) else _plain(inner, left, depth - 1)
    if isinstance(value, list | tuple):
        return [_plain(each, left, depth - 1) for each in value]
    if isinstance(value, dict):
        return {
            key: _plain(each, left, depth - 1)
            for key, each in value.items()
            if isinstance(key, str)
        }
    if value is None or isinstance(value, str | bytes | int | float | np.ndarray):
        return value
    raise pickle.UnpicklingError(f"it holds a {type(value).__name__}")
