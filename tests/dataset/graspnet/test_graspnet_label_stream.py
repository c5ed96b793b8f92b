"""Grasp labels read in pieces: the same numbers as the whole, one sentence for every fault."""

import io
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.dataset.graspnet import graspnet_label_stream as stream
from pipelines.dataset.graspnet.graspnet_label_stream import grasp_label_pieces, read_grasp_label
from pipelines.dataset.graspnet.graspnet_labels import LABEL_GRID, GraspLabel
from pipelines.errors import FormatError

NUM_POINTS = 5


def arrays(count: int = NUM_POINTS) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    shape = (count, *LABEL_GRID)
    return {
        "points": rng.random((count, 3), np.float32),
        "offsets": rng.random((*shape, 3), np.float32),
        "collision": rng.random(shape) > 0.5,
        "scores": rng.choice(np.array([-1.0, 0.1, 0.4], np.float32), shape),
    }


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("labels")
    np.savez(folder / "stored.npz", **arrays())
    np.savez_compressed(folder / "deflated.npz", **arrays())
    return {name: folder / f"{name}.npz" for name in ("stored", "deflated")}


def joined(path: Path, num_points: int) -> GraspLabel:
    pieces = list(grasp_label_pieces(path, num_points))
    assert all(len(piece.points) <= num_points for piece in pieces)
    columns = [[getattr(piece, name) for piece in pieces] for name in vars(pieces[0])]
    return GraspLabel(*(np.concatenate(column) for column in columns))


@settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.sampled_from(["stored", "deflated"]), st.integers(1, NUM_POINTS + 1))
def test_the_pieces_are_the_whole(saved: dict[str, Path], packing: str, num_points: int) -> None:
    whole, pieces = read_grasp_label(saved[packing]), joined(saved[packing], num_points)
    for name, array in vars(whole).items():
        assert_array_equal(getattr(pieces, name), array)
        assert getattr(pieces, name).dtype == array.dtype


def test_memory_holds_one_piece(saved: dict[str, Path]) -> None:
    for path in saved.values():
        tracemalloc.start()
        for piece in grasp_label_pieces(path, 1):
            assert len(piece.points) == 1
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 4 * 17 * np.prod(LABEL_GRID) + 2 * 2**20  # a piece is a 20th of the label


def test_other_widths_of_numbers_are_read(tmp_path: Path) -> None:
    made = arrays(1)
    other = {name: a.astype(np.float64) for name, a in made.items() if name != "collision"}
    np.savez(tmp_path / "x.npz", **other, collision=made["collision"].astype(np.uint8))
    (piece,) = grasp_label_pieces(tmp_path / "x.npz", 9)
    assert_array_equal(piece.min_friction, made["scores"])
    assert_array_equal(piece.collision, made["collision"])
    assert piece.offsets.dtype == np.float32


def test_an_object_without_grasp_points_has_no_pieces(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", **arrays(0))
    assert list(grasp_label_pieces(tmp_path / "x.npz", 4)) == []


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"scores": None, "collision": None}, "lacks the arrays collision, scores"),
        ({"points": np.zeros((2, 4), np.float32)}, r"points of shape \(2, 4\)"),
        ({"offsets": np.zeros((2, *LABEL_GRID), np.float32)}, "offsets of shape"),
        ({"scores": np.zeros((1, *LABEL_GRID), np.float32)}, "scores of shape"),
        ({"points": np.full((2, 3), np.nan, np.float32)}, "points are not all finite"),
        (
            {"offsets": np.full((2, *LABEL_GRID, 3), np.nan, np.float32)},
            "offsets of grasps that hold",
        ),
        ({"scores": np.zeros((2, *LABEL_GRID), np.int16)}, "scores is of type int16"),
        ({"collision": np.zeros((2, *LABEL_GRID), np.float32)}, "collision is of type float32"),
        ({"scores": np.asfortranarray(np.zeros((2, *LABEL_GRID), np.float32))}, "Fortran"),
        ({"points": np.array([[None] * 3] * 2, object)}, "pickles are never read"),
        ({"points": np.zeros((stream.MAX_LABEL_POINTS + 1, 3), np.float32)}, "at most 100000"),
    ],
)
def test_wrong_arrays_are_reported_in_one_sentence(
    tmp_path: Path, change: dict[str, np.ndarray | None], sentence: str
) -> None:
    changed = {name: a for name, a in (arrays(2) | change).items() if a is not None}
    np.savez(tmp_path / "007_labels.npz", allow_pickle=True, **changed)
    with pytest.raises(FormatError, match=sentence) as error:
        list(grasp_label_pieces(tmp_path / "007_labels.npz", 1))
    assert "007_labels.npz" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("packing", ["stored", "deflated"])
@pytest.mark.parametrize("kept", [0, 100, 0.5, 0.999])
def test_a_truncated_archive_is_reported_in_one_sentence(
    tmp_path: Path, saved: dict[str, Path], packing: str, kept: float
) -> None:
    data = saved[packing].read_bytes()
    (tmp_path / "x.npz").write_bytes(data[: int(kept * len(data)) if kept < 1 else int(kept)])
    with pytest.raises(FormatError, match="whole"):
        list(grasp_label_pieces(tmp_path / "x.npz", 2))


@pytest.mark.parametrize("packing", ["stored", "deflated"])
def test_damage_in_the_middle_is_reported_in_one_sentence(
    tmp_path: Path, saved: dict[str, Path], packing: str
) -> None:
    data = bytearray(saved[packing].read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    (tmp_path / "x.npz").write_bytes(data)
    with pytest.raises(FormatError, match=r"x\.npz"):
        list(grasp_label_pieces(tmp_path / "x.npz", 2))


def header(shape: tuple[int, ...], descr: str = "<f4") -> bytes:
    buffer = io.BytesIO()
    stored = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(buffer, stored)
    return buffer.getvalue()


def with_scores(path: Path, data: bytes, compression: int = zipfile.ZIP_DEFLATED) -> None:
    """An archive whose `scores` member is `data`, everything else right for two points."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, array in arrays(2).items():
            buffer = io.BytesIO()
            np.save(buffer, array)
            archive.writestr(f"{name}.npy", data if name == "scores" else buffer.getvalue())


def test_a_member_that_unpacks_to_more_than_its_shape_is_refused(tmp_path: Path) -> None:
    with_scores(tmp_path / "x.npz", header((2, *LABEL_GRID)) + bytes(40_000_000))
    with pytest.raises(FormatError, match=r"scores unpacks to 40000128 bytes"):
        list(grasp_label_pieces(tmp_path / "x.npz", 1))


def test_a_member_that_claims_a_huge_shape_is_refused(tmp_path: Path) -> None:
    with_scores(tmp_path / "x.npz", header((10**9, *LABEL_GRID)))
    with pytest.raises(FormatError, match="takes"):
        list(grasp_label_pieces(tmp_path / "x.npz", 1))


def test_a_size_that_no_deflation_gives_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    with_scores(path, header((2, *LABEL_GRID)) + bytes(4 * 2 * int(np.prod(LABEL_GRID))))
    data = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        packed = archive.getinfo("scores.npy").file_size
    bomb = data.replace(packed.to_bytes(4, "little"), (2**31).to_bytes(4, "little"))
    assert bomb != data
    path.write_bytes(bomb)
    with pytest.raises(FormatError, match="times its size is possible"):
        list(grasp_label_pieces(path, 1))


def test_other_ways_of_packing_are_refused(tmp_path: Path) -> None:
    scores = header((2, *LABEL_GRID)) + bytes(4 * 2 * int(np.prod(LABEL_GRID)))
    with_scores(tmp_path / "x.npz", scores, zipfile.ZIP_LZMA)
    with pytest.raises(FormatError, match="stored or deflated"):
        list(grasp_label_pieces(tmp_path / "x.npz", 1))
