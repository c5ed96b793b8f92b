"""Rows of candidates: groups of different scenes stay separate, unknown truth is left out."""

import h5py
import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.learning.critics import critic_rows
from pipelines.learning.critics.critic_rows import COLUMNS, CriticRows
from pipelines.learning.critics.kinds import CRITIC_KINDS
from pipelines.storage.provenance import make_stamp
from tests.learning.critics.rows import made_rows

STAMP = make_stamp("train-critic", {})


def test_groups_of_several_files_stay_separate_and_unknown_truth_is_left_out(tmp_path):
    parts = [made_rows(CRITIC_KINDS["planes"], 2, 4, seed) for seed in (0, 1)]
    parts[1].truth[0] = np.nan
    paths = [tmp_path / "a.h5", tmp_path / "b.h5"]
    for path, rows in zip(paths, parts, strict=True):
        critic_rows.write(path, rows, STAMP)
    found = critic_rows.read_known(paths)
    assert found.group.tolist() == [0] * 4 + [1] * 4 + [2] * 3 + [3] * 4
    for name in COLUMNS[:-1]:
        expected = [getattr(parts[0], name), getattr(parts[1], name)[1:]]
        np.testing.assert_array_equal(getattr(found, name), np.concatenate(expected))


def test_a_scene_without_candidates_gets_a_file_too(tmp_path):
    kind = CRITIC_KINDS["grasps"]
    none = CriticRows.none(8, kind.features)
    critic_rows.write(tmp_path / "none.h5", none, STAMP)
    critic_rows.write(tmp_path / "some.h5", made_rows(kind, 1, 3), STAMP)
    assert len(critic_rows.read_known([tmp_path / "none.h5"])) == 0
    found = critic_rows.read_known([tmp_path / "none.h5", tmp_path / "some.h5"])
    assert found.points.shape == (3, 8, len(kind.features.point))


def test_the_same_rows_give_the_same_bytes(tmp_path):
    for name in ("a.h5", "b.h5"):
        critic_rows.write(tmp_path / name, made_rows(CRITIC_KINDS["planes"], 2, 4), STAMP)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


@pytest.mark.parametrize(
    ("name", "damage", "fault"),
    [
        ("truth", lambda rows: rows[:-1], "its columns differ in length"),
        ("truth", lambda rows: rows + 9, "/truth is outside of 0 to 1"),
        ("points", lambda rows: rows * np.nan, "/points is not finite"),
        ("candidates", lambda rows: rows * np.inf, "/candidates is not finite"),
        ("shared", lambda rows: np.full(len(rows), "a", h5py.string_dtype()), "a column is not"),
    ],
)
def test_damaged_rows_are_named(tmp_path, name, damage, fault):
    path = tmp_path / "rows.h5"
    critic_rows.write(path, made_rows(CRITIC_KINDS["planes"], 2, 4), STAMP)
    with h5py.File(path, "r+") as file:
        rows = file[name][()]
        del file[name]
        file[name] = damage(rows)
    with pytest.raises(FormatError, match=rf"rows.h5: {fault}.*pass --overwrite"):
        critic_rows.read_known([path])
