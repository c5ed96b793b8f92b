"""Reading of pickles: their numbers are read, and nothing in them is ever run."""

import builtins
import collections
import contextlib
import os
import pickle
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError
from pipelines.frames.encodings import plain_pickle
from pipelines.frames.encodings.plain_pickle import ALLOWED, read_plain_pickle

CONTENT = {
    "depth": np.arange(12, dtype=np.float32).reshape(3, 4),
    "turned": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "big": np.arange(3, dtype=">u2"),
    "flags": np.array([True, False]),
    "scale": np.float64(2.5),
    "name": "mug",
    "raw": b"\x00\xff",
    "list": [1, 2.0, (np.arange(2), None)],
}
# As written by numpy 1 under Python 2: {"K": array([[1., 2.]]), "n": float32(3)}, protocol 2.
PYTHON_2 = (
    b"\x80\x02}q\x00(U\x01Kq\x01cnumpy.core.multiarray\n_reconstruct\nq\x02cnumpy\nndarray\nq\x03"
    b"K\x00\x85U\x01b\x87Rq\x04(K\x01K\x01K\x02\x86cnumpy\ndtype\nq\x05U\x02f8K\x00K\x01\x87Rq\x06"
    b"(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U\x10"
    + np.array([1.0, 2.0]).tobytes()
    + b"tbu."
)


def read(path: Path, data: bytes) -> Any:
    path.write_bytes(data)
    return read_plain_pickle(path)


def assert_same(found: dict[str, Any], expected: dict[str, Any]) -> None:
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        if isinstance(value, np.ndarray):
            assert_array_equal(found[name], value)
            assert found[name].dtype == value.dtype
    assert found["scale"] == 2.5
    assert found["raw"] == b"\x00\xff"
    assert_array_equal(found["list"][2][0], [0, 1])


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_numbers_come_out_of_every_protocol(tmp_path: Path, protocol: int) -> None:
    assert_same(read(tmp_path / "a.pkl", pickle.dumps(CONTENT, protocol)), CONTENT)


def test_numpys_own_pickled_files_are_read(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", CONTENT, allow_pickle=True)
    assert_same(read_plain_pickle(tmp_path / "a.npy"), CONTENT)


def test_a_pickle_of_python_2_is_read(tmp_path: Path) -> None:
    assert_array_equal(read(tmp_path / "a.pkl", PYTHON_2)["K"], [[1.0, 2.0]])


def test_a_real_file_of_python_2_is_read(shared: Path) -> None:
    content = read_plain_pickle(shared / "frames/6dofgraspnet_realsense/native/blue_mug.npy")
    assert content["depth"].shape == (480, 640)
    assert content["image"].dtype == np.uint8
    assert content["intrinsics_matrix"].shape == (3, 3)


class Calls:
    """An object whose pickle holds a call."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return self.call


def calls(flag: Path) -> dict[str, Any]:
    """Calls that a pickle must never make; each would leave a file where it ran."""
    write = f"__import__('pathlib').Path({str(flag)!r}).touch()"
    return {
        "system": Calls(os.system, f"touch {flag}"),
        "eval": Calls(builtins.eval, write),
        "exec": Calls(builtins.exec, write),
        "popen": Calls(subprocess.Popen, ["touch", str(flag)]),
        "getattr": Calls(getattr, "x", "upper"),
        "touch": Calls(Path.touch, flag),
        "load": Calls(np.load, str(flag), None, True),
        "loads": Calls(pickle.loads, pickle.dumps(Calls(builtins.eval, write))),
        "import": Calls(builtins.__import__, "antigravity"),
        "ordered": collections.OrderedDict(a=1),
        "set": {1, 2},
    }


@pytest.mark.parametrize("kind", calls(Path("x")))
@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
def test_nothing_is_ever_called(tmp_path: Path, kind: str, protocol: int) -> None:
    flag = tmp_path / "flag"
    bad = calls(flag)[kind]
    for content in (bad, {"depth": bad}, [np.zeros(2), {"a": (bad,)}]):
        with pytest.raises(FormatError, match="this pickle is not read"):
            read(tmp_path / "a.pkl", pickle.dumps(content, protocol))
    assert not flag.exists()


@pytest.mark.parametrize("kind", ["system", "eval", "loads"])
def test_objects_in_numpys_arrays_are_not_called_either(tmp_path: Path, kind: str) -> None:
    flag = tmp_path / "flag"
    hidden = np.zeros((2, 2), object)
    hidden[1, 1] = calls(flag)[kind]
    np.save(tmp_path / "a.npy", {"depth": hidden}, allow_pickle=True)
    with pytest.raises(FormatError, match="it asks for"):
        read_plain_pickle(tmp_path / "a.npy")
    assert not flag.exists()


CALLED_BY_HAND = {
    # protocol 0: `c` fetches a name, `(..tR` calls it, `b` sets its state
    "global": b"cposix\nsystem\n(S'true'\ntR.",
    "inst": b"(S'true'\nios\nsystem\n.",
    "obj": b"(cos\nsystem\nS'true'\no.",
    "newobj": b"\x80\x02cbuiltins\neval\nS'1'\n\x85\x81.",
    "stack_global": b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x011\x85R.",
    "dotted": b"\x80\x04\x8c\x05numpy\x8c\x0edtype.__init__\x93.",
    "stands_init": b"\x80\x04\x8c\x05numpy\x8c\x05dtype\x93}b.",
    "extension": b"\x80\x02\x82\x01.",
    "persistent": b"\x80\x02K\x01Q.",
    "buffer": b"\x80\x05\x97.",
    "circle": b"]q\x00h\x00a.",
}


@pytest.mark.parametrize("name", CALLED_BY_HAND)
def test_pickles_written_by_hand_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(FormatError, match="this pickle is not read"):
        read(tmp_path / "a.pkl", CALLED_BY_HAND[name])


def test_containers_that_unfold_without_end_are_refused(tmp_path: Path) -> None:
    bomb: Any = []
    for _ in range(18):
        bomb = [bomb] * 10
    with pytest.raises(FormatError, match="without end"):
        read(tmp_path / "a.pkl", pickle.dumps(bomb))


@pytest.mark.parametrize("put", [b"r\xff\xff\xff\x7f", b"p2147483647\n"])
def test_a_large_memo_index_takes_no_memory(tmp_path: Path, put: bytes) -> None:
    with pytest.raises(FormatError, match="at place 2147483647"):
        read(tmp_path / "a.pkl", b"]" + put + b".")


def test_arrays_that_claim_missing_data_are_refused(tmp_path: Path) -> None:
    data = pickle.dumps(np.arange(2.0), 2).replace(b"K\x02\x85", b"K\x7f\x85")
    with pytest.raises(FormatError, match="reshape"):
        read(tmp_path / "a.pkl", data)


def test_the_allowed_names_are_few_and_harmless() -> None:
    assert {module.split(".")[0] for module, _name in ALLOWED} == {"numpy", "_codecs"}
    assert all(each.__module__ == plain_pickle.__name__ for each in ALLOWED.values())
    assert len(ALLOWED) == 13


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 400), st.integers(0, 5))
def test_damaged_pickles_give_a_sentence_or_numbers(
    tmp_path_factory: pytest.TempPathFactory, piece: bytes, at: int, protocol: int
) -> None:
    data = pickle.dumps(CONTENT, protocol)
    path = tmp_path_factory.getbasetemp() / "damaged.pkl"
    with contextlib.suppress(FormatError):
        read(path, data[:at] + piece + data[at + len(piece) :])
