"""Grasps as a table of text."""

import csv

import numpy as np

from pipelines.grasp_files.exports import grasp_csv
from tests.grasp_files.exports.gripper_toys import random_frame


def test_awkward_names_and_messages_stay_in_their_line(tmp_path):
    rng = np.random.default_rng(0)
    full, header = random_frame(rng, 2, name='a "b", #1')
    bare, _ = random_frame(rng, 0, name="c\nd")
    grasp_csv.write(tmp_path / "x.csv", [full, bare], header)
    with (tmp_path / "x.csv").open(newline="") as stream:
        lines = stream.read().split("\n")
    assert [line for line in lines if line.startswith("# no grasps")] == [
        '# no grasps in "c\\nd" (empty): '
    ]
    rows = list(csv.DictReader(line for line in lines if line and not line.startswith("#")))
    assert [row["frame"] for row in rows] == ['a "b", #1'] * 2
    assert [row["grasp"] for row in rows] == ["100", "101"]


def test_our_file_is_recognised_by_its_first_line(tmp_path):
    frame, header = random_frame(np.random.default_rng(0), 1)
    grasp_csv.write(tmp_path / "x.csv", [frame], header)
    (tmp_path / "y.csv").write_text("a,b\n1,2\n")
    assert grasp_csv.is_ours(tmp_path / "x.csv")
    assert not grasp_csv.is_ours(tmp_path / "y.csv")


def test_no_cell_begins_like_a_formula(tmp_path):
    rng = np.random.default_rng(0)
    names = ("=1+1", "@SUM(A1)", "+a", "-b", "a,=1")
    full = [random_frame(rng, 1, name=name) for name in names]
    bare, header = random_frame(rng, 0, name="a,=cmd|x")
    grasp_csv.write(tmp_path / "x.csv", [frame for frame, _ in full] + [bare], header)
    with (tmp_path / "x.csv").open(newline="") as stream:
        cells = [cell for line in csv.reader(stream) for cell in line]
    assert not [cell for cell in cells if cell[:1] in ("=", "@", "\t", "\r")]
    assert not [cell for cell in cells if cell[:1] in ("+", "-") and not _is_number(cell)]
    assert {"./=1+1", "./@SUM(A1)", "./+a", "./-b", "a,=1"} <= set(cells)


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
