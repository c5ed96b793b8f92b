"""YAML files of cameras: every form that users have, limits of size, damage."""

from pathlib import Path

import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import read_camera_file
from pipelines.frames.encodings.yaml_files import read_yaml

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
    "quoted keys": f'"width": 64\nheight: "48"\n"K": {ROWS}\n',
    "JSON in a YAML file": f'{{"width": 64, "height": 48, "K": {ROWS}}}',
    "a flow mapping": f"width: 64\nheight: 48\ncamera_matrix: {{rows: 3, cols: 3, data: {ROWS}}}\n",
    "OpenCV 2": (
        "%YAML:1.0\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n"
        f"   rows: 3\n   cols: 3\n   dt: d\n   data: {ROWS}\n"
    ),
    "indented by tabs": f"width: 64\nheight: 48\ncamera_matrix:\n\trows: 3\n\tdata: {ROWS}\n",
    "no blank after the colon": "width:64\nheight:48\nfx:60\nfy:61\ncx:31.5\ncy:23.5\n",
    "zeros before, exponents": "width: 064\nheight: 048\nfx: 6e1\nfy: 061\ncx: 3.15e1\ncy: 23.5\n",
    "printed by numpy": "width: 64\nheight: 48\nK: [[60. 0. 31.5]\n [0. 61. 23.5]\n [0. 0. 1.]]\n",
    "blanks between": "width: 64\nheight: 48\nK: 60 0 31.5 0 61 23.5 0 0 1\n",
    "a byte order mark": f"\ufeffwidth: 64\nheight: 48\nK: {ROWS}\n",
    "over several lines": "width: 64\nheight: 48\nK: [60, 0, 31.5, #1\n0, 61, 23.5,\n 0, 0, 1]\n",
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_a_camera_is_read(tmp_path: Path, form: str) -> None:
    (tmp_path / "c.yaml").write_text(FORMS[form])
    camera = read_camera_file(tmp_path / "c.yaml")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == FOUR
    assert (camera.width, camera.height) == (64, 48)
    assert camera.units_per_metre is None


def test_a_comment_does_not_hide_a_number(tmp_path: Path) -> None:
    text = f"K: {ROWS}  # row by row\ndepth_scale: 4000  # L515: 0.25 mm\nwidth: 64 #\nheight: 48\n"
    (tmp_path / "c.yaml").write_text(text)
    camera = read_camera_file(tmp_path / "c.yaml")
    assert (camera.width, camera.height, camera.units_per_metre) == (64, 48, 4000.0)


def test_a_unit_that_is_no_number_is_refused_and_not_passed_over(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(f"K: {ROWS}\ndepth_scale: 4000 per metre\n")
    with pytest.raises(FormatError, match="4000 per metre"):
        read_camera_file(tmp_path / "c.yaml")


def test_values_are_numbers_texts_lists_and_nested_mappings(tmp_path: Path) -> None:
    text = "a:\n  b: 1\n  c: [2, x]\nd:\n- - 3\n  - 4\nf: ~\ng:\nh: x#y\ni: -1\nj: 1:30\nk: yes\n"
    (tmp_path / "c.yaml").write_text(text)
    assert read_yaml(tmp_path / "c.yaml") == {
        "a": {"b": 1.0, "c": [2.0, "x"]},
        "d": [[3.0, 4.0]],
        "f": None,
        "g": None,
        "h": "x#y",
        "i": -1.0,
        "j": "1:30",
        "k": "yes",
    }


def test_the_first_document_and_the_first_of_equal_keys_count(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("a: 1\na: 2\n---\na: 3\nb: 4\n---\na: 5\n---\nc: 6\n")
    assert read_yaml(tmp_path / "c.yaml") == {"a": 1.0, "b": 4.0}


@pytest.mark.parametrize(
    ("text", "content"),
    [
        ("[[1, 2], [3, 4]]", [[1.0, 2.0], [3.0, 4.0]]),
        ("- 1\n- a: x\n---\n- 2\n---\nb: [3,\n", [1.0, {"a": "x"}]),
        ("- 1\n---\na: 2\n", {"a": 2.0}),
        ("# nothing\n", None),
    ],
)
def test_without_a_key_the_first_list_is_the_content(
    tmp_path: Path, text: str, content: object
) -> None:
    (tmp_path / "c.yaml").write_text(text)
    assert read_yaml(tmp_path / "c.yaml") == content


def test_a_list_is_no_camera(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("- 600\n- 600\n")
    with pytest.raises(FormatError, match="this has no keys; fx, fy"):
        read_camera_file(tmp_path / "c.yaml")


def test_damage_below_the_first_document_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("a: 1\n---\na: 2\nb: [3,\n")
    assert read_yaml(tmp_path / "c.yaml") == {"a": 1.0}


BOMB = "a: &a [1]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]\n"
REFUSED = {
    "an alias": (BOMB, "line 2 cannot be read .an alias"),
    "an alias of itself": ("a: &a [*a]\n", "line 1 cannot be read .an alias"),
    "deep lists": ("a: " + 1000 * "[" + 1000 * "]", "more than 20 levels"),
    "a list that does not end": ("b: 1\na: [1,\n", "line 3 cannot be read"),
    "an escape that is no character": ('a: "\\UFFFFFFFF"\n', "this is no YAML"),
    "more than a camera": ("a: [" + "1, " * 400_000 + "]", "a document of more than 1048576 bytes"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_files_that_could_cost_much_or_are_damaged_are_reported_in_one_sentence(
    tmp_path: Path, kind: str
) -> None:
    text, sentence = REFUSED[kind]
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(FormatError, match=sentence) as caught:
        read_camera_file(tmp_path / "c.yaml")
    assert "\n" not in str(caught.value)


def test_a_long_recording_is_read_as_its_first_message(tmp_path: Path) -> None:
    message = FORMS["rostopic echo"]
    (tmp_path / "c.yaml").write_text(message * (2**21 // len(message)))
    assert read_camera_file(tmp_path / "c.yaml").fx == 60.0


@pytest.mark.parametrize("tag", ["python/object/apply:os.system", "python/name:os.system", "bool"])
def test_tags_give_only_texts_and_numbers(tmp_path: Path, tag: str) -> None:
    (tmp_path / "c.yaml").write_text(f"a: !!{tag} ['1']\nb: !!{tag} 2\n")
    assert read_yaml(tmp_path / "c.yaml") == {"a": [1.0], "b": 2.0}
