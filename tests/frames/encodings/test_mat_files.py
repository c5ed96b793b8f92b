"""MATLAB 5 files: files of scipy are read back, damage gives an error sentence."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError
from pipelines.frames.encodings.mat_files import read_mat

CONTENT = {
    "intrinsic_matrix": np.arange(9.0).reshape(3, 3),
    "factor_depth": np.array([[1000]], np.uint16),
    "poses": np.arange(36, dtype=np.float32).reshape(3, 4, 3),
    "cls_indexes": np.zeros((1, 0)),
    "small": np.array([[-3]], np.int8),
    "wide": np.array([[2**40, -1]], np.int64),
}


@pytest.mark.parametrize("compress", [True, False])
def test_a_file_that_scipy_writes_is_read_back(tmp_path: Path, compress: bool) -> None:
    path = tmp_path / "x.mat"
    extra = {"text": "words", "cell": {"a": 1}, "complex": np.array([1j])}
    scipy.io.savemat(path, CONTENT | extra, do_compression=compress)
    read = read_mat(path)
    assert read.keys() == CONTENT.keys()
    for name, expected in CONTENT.items():
        assert read[name].dtype == expected.dtype
        assert_array_equal(read[name], expected)


def test_other_versions_are_refused_with_the_way_to_save(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"x": np.eye(3)}, format="4")
    with pytest.raises(FormatError, match="save -v7"):
        read_mat(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(126) + b"IM")
    with pytest.raises(FormatError, match="save -v7"):
        read_mat(path)


def test_every_cut_gives_a_sentence_or_fewer_arrays(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, CONTENT)
    whole = path.read_bytes()
    for end in range(0, len(whole), 7):
        path.write_bytes(whole[:end])
        try:
            read = read_mat(path)
        except FormatError:
            continue
        assert len(read) < len(CONTENT)
