"""HDF5 files end with a check sum, so that damage is reported before HDF5 reads the file."""

import os
import sys

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.errors import FormatError, SymgraspError, WriteError
from pipelines.storage.h5_columns import write_columns
from pipelines.storage.h5_files import MARK, SEAL, new_h5, open_h5
from pipelines.storage.provenance import read_stamp
from tests.storage.full_disk import little_space

COLUMNS = {"name": ["a", "bb", "ü"], "value": np.arange(300.0).reshape(3, 100)}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("h5") / "sound.h5"
    with new_h5(path) as file:
        file.attrs["provenance"] = "{}"
        write_columns(file, COLUMNS)
    return path


def test_a_file_ends_with_its_check_sum_and_other_readers_open_it(sound):
    assert sound.read_bytes()[-SEAL.size :].startswith(MARK)
    with open_h5(sound) as ours, h5py.File(sound) as anyone:
        for file in (ours, anyone):
            np.testing.assert_array_equal(file["value"][()], COLUMNS["value"])
            assert list(file["name"].asstr()[()]) == COLUMNS["name"]


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_no_changed_byte_reaches_hdf5(sound, tmp_path_factory, data):
    whole = sound.read_bytes()
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(whole) - SEAL.size - 1))
        content[place] ^= data.draw(st.integers(1, 255))
    if bytes(content) == whole:
        return
    damaged = tmp_path_factory.mktemp("damaged") / "x.h5"
    damaged.write_bytes(content)
    with pytest.raises(FormatError, match="check sum"):
        open_h5(damaged)


@settings(max_examples=50, deadline=None)
@given(share=st.floats(0.0, 0.999))
def test_a_cut_off_file_is_reported_in_one_sentence(sound, tmp_path_factory, share):
    whole = sound.read_bytes()
    cut = tmp_path_factory.mktemp("cut") / "x.h5"
    cut.write_bytes(whole[: int(share * (len(whole) - SEAL.size))])
    with pytest.raises(FormatError, match="not a whole HDF5 file"):
        open_h5(cut)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of file sizes")
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_full_disk_is_reported_in_one_sentence_and_leaves_nothing(share, tmp_path, capfd):
    def write(path):
        with new_h5(path) as file:
            for group in range(9):
                columns = {f"{column}": np.full((400, 3), group) for column in range(9)}
                write_columns(file.create_group(str(group)), columns)

    write(tmp_path / "whole.h5")
    size = (tmp_path / "whole.h5").stat().st_size
    with (
        little_space(int(share * size)),
        pytest.raises(WriteError, match=r"/x.h5 cannot .*File too"),
    ):
        write(tmp_path / "x.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["whole.h5"]
    assert capfd.readouterr().err == ""


def test_files_of_other_programs_and_edited_files_are_opened(sound, tmp_path):
    edited = tmp_path / "edited.h5"
    edited.write_bytes(sound.read_bytes())
    with h5py.File(edited, "r+") as file:
        file["value"][0, 0] = 7.0  # no byte more or less
    with open_h5(edited) as file:
        assert file["value"][0, 0] == 7.0
    with h5py.File(edited, "a") as file:
        file.attrs["note"] = "mine"
    with open_h5(edited) as file:
        assert file.attrs["note"] == "mine"
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = 1
    with open_h5(other) as file:
        assert file["x"][()] == 1


def test_damage_after_a_file_was_read_is_detected(sound, tmp_path):
    path = tmp_path / "x.h5"
    content = bytearray(sound.read_bytes())
    path.write_bytes(content)
    open_h5(path).close()
    content[len(content) // 2] ^= 1
    path.unlink()
    path.write_bytes(content)
    with pytest.raises(FormatError, match="check sum"):
        open_h5(path)
    open_h5(path, checked=False).close()


def test_a_failed_write_leaves_no_file(tmp_path):
    def half(path):
        with new_h5(path) as file:
            file["x"] = 1
            raise RuntimeError("half")

    with pytest.raises(RuntimeError, match="half"):
        half(tmp_path / "x.h5")
    assert list(tmp_path.iterdir()) == []


def _external(file, pipe):
    file["x"] = h5py.ExternalLink(str(pipe), "x")


def _raw(file, pipe):
    file.create_dataset("x", (4,), "f4", external=[(str(pipe), 0, 16)])


def _virtual(file, pipe):
    layout = h5py.VirtualLayout((4,), "f4")
    layout[...] = h5py.VirtualSource(str(pipe), "x", (4,))
    file.create_virtual_dataset("x", layout)


def _loop(file, _pipe):
    file["x"] = h5py.SoftLink("/x")


def _itself(file, _pipe):
    file.create_group("a")["b"] = file["/"]


def _huge(file, _pipe):
    file.create_dataset("x", (10**9,), "f8", chunks=True, compression="gzip")


def _huge_chunk(file, _pipe):
    file.create_dataset("x", (1,), "f8", maxshape=(None,), chunks=(2**28,))


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize(
    "harm",
    [_external, _raw, _virtual, _loop, _itself, _huge, _huge_chunk],
    ids=lambda h: h.__name__,
)
def test_links_out_of_a_file_and_datasets_beyond_memory_are_refused(tmp_path, harm, sealed):
    pipe, path = tmp_path / "pipe", tmp_path / "x.h5"
    os.mkfifo(pipe)  # to open it would never end
    if sealed:
        with new_h5(path) as file:
            harm(file, pipe)
    else:
        with h5py.File(path, "w") as file:
            harm(file, pipe)
    with pytest.raises(FormatError, match=r"in the file itself is read|datasets of .* bytes"):
        open_h5(path)


def test_a_stamp_is_read_without_reading_datasets_and_their_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with new_h5(tmp_path / "x.h5") as file:
        file.attrs["provenance"] = '{"stage": "infer"}'
        _raw(file, tmp_path / "pipe")
    assert read_stamp(tmp_path / "x.h5") == {"stage": "infer"}


def test_a_pipe_in_the_place_of_a_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "x.h5")
    with pytest.raises(SymgraspError, match="is no plain file"):
        open_h5(tmp_path / "x.h5")
