"""Labels joined from parts."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from pipelines.dataset.graspnet.graspnet_label_stream import read_grasp_label
from pipelines.dataset.graspnet.graspnet_labels import (
    LABEL_ARRAYS,
    LABEL_GRID,
    GraspLabel,
    join_grasp_labels,
    label_offsets,
    part_arrays,
    write_grasp_label,
)
from pipelines.errors import FormatError


def some_label(seed: int, count: int) -> GraspLabel:
    rng = np.random.default_rng(seed)
    width = rng.uniform(0.0, 0.1, (count, *LABEL_GRID))
    friction = rng.integers(1, 11, width.shape).astype(np.float32) / 10
    points = rng.normal(size=(count, 3)).astype(np.float32)
    return GraspLabel(points, label_offsets(width), width > 0.05, friction)


@pytest.fixture
def parts(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{i}.npz" for i in range(3)]
    for i, path in enumerate(paths):
        write_grasp_label(path, some_label(i, i + 1), compress=False)
    return paths


@pytest.mark.parametrize("compress", [False, True])
def test_parts_are_joined_in_their_order(tmp_path: Path, parts: list[Path], compress: bool) -> None:
    join_grasp_labels(tmp_path / "all.npz", parts, compress=compress)
    joined = read_grasp_label(tmp_path / "all.npz")
    pieces = [read_grasp_label(part) for part in parts]
    for name in ("points", "offsets", "collision", "min_friction"):
        expected = np.concatenate([getattr(piece, name) for piece in pieces])
        np.testing.assert_array_equal(getattr(joined, name), expected)
    with zipfile.ZipFile(tmp_path / "all.npz") as archive:
        kinds = {member.compress_type for member in archive.infolist()}
    assert kinds == {zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED}


def test_a_joined_label_has_the_bytes_of_one_that_was_written_whole(
    tmp_path: Path, parts: list[Path]
) -> None:
    pieces = [read_grasp_label(part) for part in parts]
    names = ("points", "offsets", "collision", "min_friction")
    whole = GraspLabel(*(np.concatenate([getattr(p, name) for p in pieces]) for name in names))
    write_grasp_label(tmp_path / "whole.npz", whole, compress=False)
    join_grasp_labels(tmp_path / "all.npz", parts)
    with (
        zipfile.ZipFile(tmp_path / "all.npz") as one,
        zipfile.ZipFile(tmp_path / "whole.npz") as other,
    ):
        for name in LABEL_ARRAYS:
            assert one.read(f"{name}.npy") == other.read(f"{name}.npy")


def test_only_one_array_of_a_part_is_read(parts: list[Path]) -> None:
    assert [len(points) for points in part_arrays(parts, "points")] == [1, 2, 3]


def test_a_damaged_part_is_reported_in_one_sentence_and_leaves_nothing(
    tmp_path: Path, parts: list[Path]
) -> None:
    parts[1].write_bytes(parts[1].read_bytes()[:-200])
    with pytest.raises(FormatError, match=r"1\.npz"):
        join_grasp_labels(tmp_path / "all.npz", parts)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.npz", "1.npz", "2.npz"]
