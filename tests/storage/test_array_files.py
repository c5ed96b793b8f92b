"""Reading and writing of .npy and .npz files."""

import zipfile

import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.storage.array_files import read_npy, read_npz, write_npz


def test_arrays_round_trip_and_truncated_ones_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    write_npz(path, x=np.arange(1000), y=np.eye(3))
    assert read_npz(path, ["x"])["y"].shape == (3, 3)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FormatError, match=r"whole \.npz"):
        read_npz(path)


def test_a_missing_array_is_named(tmp_path):
    path = tmp_path / "a.npz"
    write_npz(path, x=np.arange(3))
    with pytest.raises(FormatError, match=r"lacks the arrays scores.*holds x"):
        read_npz(path, ["x", "scores"])


def test_pickled_arrays_are_never_opened(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.array([{"evil": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError, match="pickles never"):
        read_npy(path)


@pytest.mark.parametrize("content", [b"no array at all", b"\x93NUMPY\x01\x00"])
def test_damaged_arrays_are_named_without_advice_to_unpickle(tmp_path, content):
    path = tmp_path / "damaged.npy"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"damaged.npy: this is not a whole .npy file") as caught:
        read_npy(path)
    assert "allow_pickle" not in str(caught.value)


def test_a_zip_bomb_is_refused_before_it_unpacks(tmp_path):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("a.npy", b"x")
    data = bytearray(path.read_bytes())
    # Claim 3 GiB in the central directory; the data themselves stay one byte.
    start = data.rfind(b"PK\x01\x02")
    data[start + 24 : start + 28] = (3 * 2**30).to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(FormatError, match="unpacks"):
        read_npz(path)


@pytest.mark.parametrize("kind", ["huge", "wide"])
def test_an_array_that_announces_more_than_its_file_is_refused(tmp_path, kind):
    described, shape = {"huge": ("<f8", (10**9,)), "wide": ("<U500000000", (1,))}[kind]
    with (tmp_path / "x.npy").open("wb") as stream:
        content = {"descr": described, "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(stream, content)
    with pytest.raises(FormatError, match="announces an array of shape"):
        read_npy(tmp_path / "x.npy")


@pytest.mark.parametrize("read", [read_npy, read_npz])
def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path, monkeypatch, read):
    def refuse(*_arguments, **_options):
        raise PermissionError(13, "Permission denied", "a.npz")

    write_npz(tmp_path / "a.npz", x=np.arange(3))
    monkeypatch.setattr("pathlib.Path.open", refuse)
    monkeypatch.setattr("zipfile.ZipFile", refuse)
    with pytest.raises(PermissionError):
        read(tmp_path / "a.npz")
