"""The numbers of small YAML files: comments, lists of every form, what is left out."""

from pathlib import Path

import pytest

from pipelines.errors import FormatError
from pipelines.frames.camera_files import read_camera_file
from pipelines.frames.encodings.flat_yaml import read_flat_yaml

FOUR = (60.0, 61.0, 31.5, 23.5)
ROWS = [60.0, 0.0, 31.5, 0.0, 61.0, 23.5, 0.0, 0.0, 1.0]
LINES = "".join(f"- {value}\n" for value in ROWS)
HEADER = "header:\n  stamp:\n    sec: 1\n  frame_id: camera # of the colour\n"
CALIBRATION = (
    "image_width: 64\nimage_height: 48\ncamera_name: narrow\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    f"  data: {ROWS}\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
    "  data: [0.1, 0, 0, 0, 0]\n"
)
FORMS = {
    "rostopic echo": f"{HEADER}height: 48\nwidth: 64\nD: []\nK: {ROWS}\nR: [1.0]\n---\n",
    "ros2 topic echo": f"{HEADER}height: 48\nwidth: 64\nd:\n- 0.0\nk:\n{LINES}r:\n- 1.0\n---\n",
    "of two messages, the second cut off": f"width: 64\nheight: 48\nk:\n{LINES}---\nk:\n- 60.0\n",
    "camera_calibration": CALIBRATION,
    "OpenCV": (
        "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n"
        "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 60., 0., 3.15e+01, 0., 61.,\n"
        "       23.5, 0., 0., 1. ]\nflags: 0\n"
    ),
    "indented": "width: 64\nheight: 48\nK:\n" + "".join(f"  - {value}\n" for value in ROWS),
    "rows in brackets": "width: 64\nheight: 48\nK:\n- [60, 0, 31.5]\n- [0, 61, 23.5]\n- [0,0,1]\n",
    "rows below rows": (
        "width: 64\nheight: 48\nK:\n- - 60\n  - 0\n  - 31.5\n- - 0\n  - 61\n  - 23.5\n"
        "- - 0\n  - 0\n  - 1\n"
    ),
    "over several lines": "width: 64\nheight: 48\nK: [60, 0, 31.5, #1\n0, 61, 23.5,\n 0, 0, 1]\n",
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_a_camera_is_read(tmp_path: Path, form: str) -> None:
    (tmp_path / "c.yaml").write_text(FORMS[form])
    camera = read_camera_file(tmp_path / "c.yaml")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == FOUR
    assert (camera.width, camera.height) == (64, 48)
    assert camera.units_per_metre is None


def test_a_comment_takes_no_number_away(tmp_path: Path) -> None:
    text = f"K: {ROWS}  # row by row\ndepth_scale: 4000  # L515: 0.25 mm\nwidth: 64 #\nheight: 48\n"
    (tmp_path / "c.yaml").write_text(text)
    camera = read_camera_file(tmp_path / "c.yaml")
    assert (camera.width, camera.height, camera.units_per_metre) == (64, 48, 4000.0)


def test_a_unit_that_is_no_number_is_refused_and_not_passed_over(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(f"K: {ROWS}\ndepth_scale: 4000 per metre\n")
    with pytest.raises(FormatError, match="4000 per metre"):
        read_camera_file(tmp_path / "c.yaml")


def test_what_is_not_at_the_margin_belongs_to_what_is_above_it(tmp_path: Path) -> None:
    text = "a:\n  b: 1\n  c: 2\nd:\n  data:\n  - 3\n  - 4\n  e: 5\nf: ~\ng:\nh: x#y\ni: -1\n"
    (tmp_path / "c.yaml").write_text(text)
    assert read_flat_yaml(tmp_path / "c.yaml") == {"d": [3.0, 4.0], "h": "x#y", "i": -1.0}
