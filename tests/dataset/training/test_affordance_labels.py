"""affordance/NNN.h5."""

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.dataset.training import affordance_labels
from pipelines.dataset.training.affordance_labels import AffordanceLabels, RefinementCounts
from pipelines.errors import FormatError, ValueRangeError
from pipelines.storage.provenance import is_finished, make_stamp

STAMP = make_stamp("refine-grasps", {"copies_per_turn": 36}, seed=1)


def labels(pairs: int, points: int) -> AffordanceLabels:
    rng = np.random.default_rng(0)
    return AffordanceLabels(
        contacts=rng.random((pairs, 2, 3)),
        approach=rng.random((pairs, 3)),
        quality=rng.random(pairs),
        points=rng.random((points, 3)),
        normals=rng.random((points, 3)),
        affordance=rng.random(points),
        counts=RefinementCounts(num_labelled=2 * pairs, num_originals=pairs),
    )


@pytest.mark.parametrize(("pairs", "points"), [(5, 9), (0, 9), (0, 0)])
def test_labels_come_back_as_they_were(tmp_path: Path, pairs: int, points: int) -> None:
    path, made = tmp_path / "005.h5", labels(pairs, points)
    affordance_labels.write(path, made, STAMP)
    again = affordance_labels.read(path)
    for name in (*affordance_labels.PAIR_COLUMNS, *affordance_labels.SURFACE_COLUMNS):
        assert_array_equal(getattr(again, name), getattr(made, name))
        assert getattr(again, name).dtype == np.float32
    assert again.counts == made.counts
    surface = affordance_labels.read_surface(path)
    assert surface.keys() == affordance_labels.SURFACE_COLUMNS.keys()
    assert_array_equal(surface["affordance"], made.affordance)
    assert is_finished(path, STAMP)


def test_a_file_without_counts_is_read(tmp_path: Path) -> None:
    affordance_labels.write(tmp_path / "005.h5", labels(5, 9), STAMP)
    with h5py.File(tmp_path / "005.h5", "a") as file:
        del file.attrs["num_labelled"]
    assert affordance_labels.read(tmp_path / "005.h5").counts.num_labelled == 0


def test_the_same_labels_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.h5", "b.h5"):
        affordance_labels.write(tmp_path / name, labels(5, 9), STAMP)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_columns_of_unequal_length_are_refused() -> None:
    with pytest.raises(ValueRangeError, match="contacts"):
        dataclasses.replace(labels(5, 9), contacts=np.zeros((4, 2, 3)))


@pytest.mark.parametrize(("name", "shape"), [("points", (10, 3)), ("normals", (9, 2))])
def test_columns_of_other_shapes_are_refused_before_they_are_read(
    tmp_path: Path, name: str, shape: tuple[int, ...]
) -> None:
    path = tmp_path / "005.h5"
    affordance_labels.write(path, labels(5, 9), STAMP)
    with h5py.File(path, "a") as file:
        del file[name]
        file.create_dataset(name, shape, "f4")
    for read in (affordance_labels.read, affordance_labels.read_surface):
        with pytest.raises(FormatError, match=f"/{name} has the shape"):
            read(path)


def test_damaged_files_are_reported_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "005.h5"
    affordance_labels.write(path, labels(5, 9), STAMP)
    with h5py.File(path, "a") as file:
        del file["quality"]
    with pytest.raises(FormatError, match="quality"):
        affordance_labels.read(path)
    path.write_bytes(b"not HDF5")
    with pytest.raises(FormatError, match="HDF5"):
        affordance_labels.read(path)
