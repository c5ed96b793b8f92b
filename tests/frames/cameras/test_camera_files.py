"""Camera files of every known form."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from pipelines.errors import FormatError, SymgraspError, ValueRangeError
from pipelines.frames.cameras import camera_files
from pipelines.frames.cameras.camera_files import CameraFile, parse_camera, read_camera_file
from pipelines.frames.cameras.camera_search import find_camera_file
from pipelines.frames.encodings.yaml_files import read_yaml

FOUR = (60.0, 61.0, 31.5, 23.5)
K = [[60.0, 0.0, 31.5], [0.0, 61.0, 23.5], [0.0, 0.0, 1.0]]
ROWS = [value for row in K for value in row]
COLUMNS = [60.0, 0.0, 0.0, 0.0, 61.0, 0.0, 31.5, 23.5, 1.0]
NAMED = {"fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5}
# File name, content, and the stated depth units per metre.
# As `camera.intrinsics.save` of Zivid's SDK and snapshots of the RealSense Viewer write them.
ZIVID = """__version__:
  serializer: 1
  data: 5
CameraIntrinsics:
  CameraMatrix: {CX: 31.5, CY: 23.5, FX: 60, FY: 61}
  Distortion: {K1: 0, K2: 0, K3: 0, P1: 0, P2: 0}
"""
REALSENSE_VIEWER = """Frame Info
Type,Color
Format,RGB8
Frame Number,12
Timestamp (ms),1661.50
Resolution x,64
Resolution y,48
Bytes per pixel,3

Intrinsic:,
Fx,60.000000
Fy,61.000000
PPx,31.500000
PPy,23.500000
Distorsion,Inverse Brown Conrady
"""
FORMS = [
    ("camera.json", NAMED, None),
    ("camera.json", NAMED | {"width": 64, "height": 48, "depth_scale": 5000.0}, 5000.0),
    ("camera.json", NAMED | {"depth_scale": 0.001}, 1000.0),
    ("camera.json", {"cam_K": ROWS, "depth_scale": 0.1}, 10000.0),
    ("camera.json", NAMED | {"depth_scale": 0.1}, 10000.0),
    ("camera.json", NAMED | {"depth_scale": 1.0}, 1000.0),
    ("camera_data.json", {"K": K, "resolution": [48, 64]}, None),
    ("camera_intrinsic.json", {"intrinsic_matrix": COLUMNS, "width": 64, "height": 48}, None),
    ("camera_params.json", {"fx": 60.0, "fy": 61.0, "x_offset": 31.5, "y_offset": 23.5}, None),
    ("phoxi.intr", {"_fx": 60.0, "_fy": 61.0, "_cx": 31.5, "_cy": 23.5, "_width": 64}, None),
    ("transforms.json", {"fl_x": 60, "fl_y": 61, "cx": 31.5, "cy": 23.5, "w": 64, "h": 48}, None),
    ("camera_info.yaml", f"height: 48\nwidth: 64\nK: {ROWS}\nroi:\n  width: 0\n", None),
    ("camera_info.json", {"K": ROWS, "D": [0.0] * 5, "P": [0.0] * 12, "roi": {"width": 0}}, None),
    ("kalibr.yaml", "cam0:\n  intrinsics: [60, 61, 31.5, 23.5]\n  resolution: [64, 48]\n", None),
    ("device.json", {"serial": 7, "color": NAMED | {"width": 64, "height": 48}}, None),
    ("camera.json", {"intrinsics": NAMED, "depth_scale": 0.001}, 1000.0),
    ("camera.json", {"K": NAMED, "resolution": {"width": 64, "height": 48}}, None),
    ("camera.json", NAMED | {"resolution": "64x48"}, None),
    ("camera.json", NAMED | {"resolution": "VGA", "width": 64, "height": 48}, None),
    ("camera.json", NAMED | {"K": "see above", "resolution": 3072}, None),
    (
        "camera.json",
        {"intrinsic_matrix": [[*row, 0.0] for row in K] + [[0.0, 0.0, 0.0, 1.0]]},
        None,
    ),
    ("intrinsics.json", K, None),
    ("intrinsics.json", ROWS, None),
    ("intrinsics.json", list(FOUR), None),
    ("my_camera.yaml", "- [60, 0, 31.5]\n- [0, 61, 23.5]\n- [0, 0, 1]\n", None),
    ("calib.json", {"intrinsicMatrix": K, "width": 64, "height": 48}, None),
    (
        "camera.json",
        {"focal_length_x": 60, "focal_length_y": 61, "principal_point_x": 31.5}
        | {"principal_point_y": 23.5},
        None,
    ),
    (
        "my_camera.ini",
        "[intrinsics]\nfx = 60\nfy = 61\ncx = 31.5\ncy = 23.5\n[images]\nwidth = 64\n",
        None,
    ),
    ("my_camera.toml", "[intrinsics]\nfx = 60\nfy = 61\ncx = 31.5\ncy = 23.5\n", None),
    ("my_camera.toml", f"K = {K}\nwidth = 64\nheight = 48\ndepth_scale = 0.001\n", 1000.0),
    ("camera_info.yaml", "intrinsics:\n  fx: 60\n  fy: 61\n  cx: 31.5\n  cy: 23.5\n", None),
    ("camera.json", {"K": [[*row, 0.0] for row in K]}, None),
    ("camera.json", {"P": [number for row in K for number in (*row, 0.0)]}, None),
    ("cam_K.txt", "60 0 31.5 0\n0 61 23.5 0\n0 0 1 0\n", None),
    ("camera.json", {"FX": 60, "FY": 61, "CX": 31.5, "CY": 23.5}, None),
    ("intrinsics.yml", ZIVID, None),
    ("x_Color_metadata.csv", REALSENSE_VIEWER, None),
    ("meta.yml", f"INTRINSICS: {ROWS}\n", None),
    ("cam_K.txt", "60 0 31.5\n0 61 23.5\n0 0 1\n", None),
    ("intrinsics.txt", "60, 61, 31.5, 23.5", None),
    ("camera_intrinsics.txt", "60 0 31.5 0\n0 61 23.5 0\n0 0 1 0\n0 0 0 1", None),
]


@pytest.mark.parametrize(("name", "content", "units"), FORMS)
def test_every_known_form_is_found_and_read(
    tmp_path: Path, name: str, content: object, units: float | None
) -> None:
    text = content if isinstance(content, str) else json.dumps(content)
    (tmp_path / name).write_text(text)
    path = find_camera_file(tmp_path, "x")
    assert path == tmp_path / name
    camera = read_camera_file(path)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == FOUR
    assert camera.units_per_metre == units
    assert camera.at(64, 48).matrix.tolist() == K


def test_a_mat_and_an_npy_hold_the_matrix(tmp_path: Path) -> None:
    scipy.io.savemat(
        tmp_path / "meta.mat", {"intrinsic_matrix": np.array(K), "factor_depth": [[10000]]}
    )
    np.save(tmp_path / "camK.npy", np.array(K))
    assert read_camera_file(tmp_path / "meta.mat").units_per_metre == 10000.0
    assert read_camera_file(tmp_path / "camK.npy").cy == 23.5


def test_a_bop_scene_has_a_camera_for_each_frame(tmp_path: Path) -> None:
    path = tmp_path / "scene_camera.json"
    path.write_text(json.dumps({"0": {"cam_K": ROWS}, "12": {"cam_K": ROWS, "depth_scale": 0.1}}))
    assert read_camera_file(path, "000012").units_per_metre == 10000.0
    with pytest.raises(FormatError, match="lacks"):
        read_camera_file(path, "000013")


def test_the_cameras_of_a_sixd_scene_are_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, reads = tmp_path / "info.yml", list[Path]()
    path.write_text("".join(f"{i}:\n  cam_K: {ROWS}\n  depth_scale: {i / 10}\n" for i in (1, 2)))

    def counted(path: Path) -> object:
        reads.append(path)
        return read_yaml(path)

    monkeypatch.setattr(camera_files, "read_yaml", counted)
    units = [read_camera_file(path, frame).units_per_metre for frame in ("0001", "0002", "0001")]
    assert units == [10000.0, 5000.0, 10000.0]
    assert reads == [path]


def test_the_cameras_of_a_bop_scene_are_read_once_for_all_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, reads = tmp_path / "scene_camera.json", []
    path.write_text(json.dumps({str(i): {"cam_K": ROWS} for i in range(9)}))
    read = camera_files.read_json
    monkeypatch.setattr(camera_files, "read_json", lambda path: reads.append(path) or read(path))
    assert {read_camera_file(path, f"{i:06d}").fx for i in range(9)} == {FOUR[0]}
    assert len(reads) == 1
    path.write_text(json.dumps({"0": {"cam_K": ROWS, "depth_scale": 0.1}}))  # a new file counts
    assert read_camera_file(path, "000000").units_per_metre == 10000.0


def test_a_frames_own_camera_comes_before_the_folders(tmp_path: Path) -> None:
    for name in ("camera.json", "x_camera.json"):
        (tmp_path / name).write_text(json.dumps(NAMED))
    assert find_camera_file(tmp_path, "x") == tmp_path / "x_camera.json"
    assert find_camera_file(tmp_path, "y") == tmp_path / "camera.json"
    assert find_camera_file(tmp_path / "none", "x") is None


def test_the_option_takes_four_numbers_or_a_file(tmp_path: Path) -> None:
    assert parse_camera("60, 61,31.5 23.5") == CameraFile(*FOUR)
    (tmp_path / "c.json").write_text(json.dumps(NAMED))
    assert parse_camera(str(tmp_path / "c.json")).fx == 60.0


@pytest.mark.parametrize("text", ["60,61", "nothing.json", "camera.docx", "0,61,31.5,23.5"])
def test_any_other_value_of_the_option_is_reported_in_one_sentence(text: str) -> None:
    with pytest.raises(SymgraspError):
        parse_camera(text)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"),
        ("a.json", "[1, 2]"),
        ("a.json", "[[1, 2], [3]]"),
        ("a.json", '["600", "x", 1, 2]'),
        ("a.json", '["fx", "fy", "cx", "cy"]'),
        ("a.json", '[{"a": 1}, 2, 3, 4]'),
        ("calib.json", '{"cameraData": [[0, 3], [1], 4, [{}, {}]]}'),
        ("calib.json", '{"cameraData": [[0, {"width": 3, "cameraType": [0]}]]}'),
        ("a.json", '{"fx": "wide", "fy": 1, "cx": 1, "cy": 1}'),
        ("a.json", '{"K": [1, 2, 3]}'),
        ("a.json", '{"K": [60, 0, 30, 0, 60, 20, 0, 0, NaN]}'),
        ("a.ini", "fx = 60\n"),
        ("a.ini", "[a\n"),
        ("a.ini", "[a]\nfx = 60\n[b]\nfx = 61\n"),
        ("a.toml", "fx = \n"),
        ("a.toml", 'fx = "wide"\nfy = 1\ncx = 1\ncy = 1\n'),
        ("a.toml", "fx = 1979-05-27\nfy = 1\ncx = 1\ncy = 1\n"),
        ("a.txt", "1 2 3"),
        ("a.txt", "camera"),
        ("a.yaml", "name: x\n"),
        ("a.json", f'{{"focal_length": 1{"0" * 400}, "cx": 1, "cy": 1}}'),
        (
            "a.json",
            f'{{"renderProductResolution": [1{"0" * 400}, 9], "cameraAperture": [1, 1], '
            '"cameraFocalLength": 1}',
        ),
    ],
)
def test_damaged_files_are_reported_in_one_sentence(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=name):
        read_camera_file(tmp_path / name)


def test_a_camera_that_was_never_calibrated_is_refused_as_such() -> None:
    with pytest.raises(FormatError, match="with 0 in its third row and column; 1 is expected"):
        CameraFile.from_matrix(Path("bag"), np.zeros((3, 3)))


def test_lengths_and_units_must_be_positive() -> None:
    with pytest.raises(ValueRangeError, match="fx"):
        CameraFile(float("nan"), 1.0, 1.0, 1.0)
    with pytest.raises(ValueRangeError, match="scale"):
        CameraFile(1.0, 1.0, 1.0, 1.0, units_per_metre=0.0)


@pytest.mark.parametrize("lengths", [(1.93, 1.93), (0.001, 60.0), (60.0, 0.5)])
def test_focal_lengths_that_are_not_in_pixels_are_refused(lengths: tuple[float, float]) -> None:
    with pytest.raises(FormatError, match="give fx and fy in pixels, not in millimetres"):
        CameraFile(*lengths, 320.0, 240.0).at(640, 480)


def test_a_wide_lens_is_read() -> None:
    assert CameraFile(20.0, 20.0, 320.0, 240.0).at(640, 480).fx == 20.0


@pytest.mark.parametrize(
    ("key", "value", "units"),
    [
        ("depth_units_per_meter", 10000, 10000.0),
        ("depth_factor", 5000.0, 5000.0),
        ("png_depth_scale", 6553.5, 6553.5),
        ("DepthMapFactor", 5000.0, 5000.0),
        ("depth_unit_scale_factor", 0.0001, 10000.0),
        ("integer_depth_scale", 0.001, 1000.0),
        ("depth_units", 0.00025, 4000.0),
        ("depth_unit", "mm", 1000.0),
        ("depth_units", "Meters", 1.0),
    ],
)
def test_the_unit_of_the_depth_has_many_names(
    tmp_path: Path, key: str, value: object, units: float
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(NAMED | {key: value}))
    assert read_camera_file(path).units_per_metre == pytest.approx(units)
    path.write_text(json.dumps(NAMED | {key: "furlongs"}))
    with pytest.raises(FormatError, match=r"furlongs.*units per metre"):
        read_camera_file(path)


@pytest.mark.parametrize(("name", "content", "units"), FORMS[:2] + FORMS[-2:])
def test_a_byte_order_mark_does_no_harm(
    tmp_path: Path, name: str, content: object, units: float | None
) -> None:
    text = content if isinstance(content, str) else json.dumps(content)
    (tmp_path / name).write_text(text, encoding="utf-8-sig")
    camera = read_camera_file(tmp_path / name)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == FOUR
    assert camera.units_per_metre == units


@pytest.mark.parametrize(("row", "column"), [(0, 1), (1, 0), (2, 0), (2, 1)])
def test_a_matrix_with_skew_or_numbers_below_its_diagonal_is_refused(
    tmp_path: Path, row: int, column: int
) -> None:
    matrix = np.array(K)
    matrix[row, column] = 1.0  # too little to matter
    assert CameraFile.from_matrix(tmp_path, matrix).fx == FOUR[0]
    matrix[row, column] = -7.0
    with pytest.raises(FormatError, match=r"skew of -7 pixels|7 below its diagonal"):
        CameraFile.from_matrix(tmp_path, matrix)


def test_a_skew_that_is_stated_by_its_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.intr").write_text(json.dumps({**NAMED, "_skew": 4.0}))
    with pytest.raises(FormatError, match="a skew of 4 pixels; rectify the images"):
        read_camera_file(tmp_path / "a.intr")
    (tmp_path / "a.intr").write_text(json.dumps({**NAMED, "_skew": 0.0}))
    assert read_camera_file(tmp_path / "a.intr").fx == FOUR[0]


@pytest.mark.parametrize(
    "keys",
    [
        {"focal_length": 600.0, "cx": 320.0, "cy": 240.0},
        {"focal_length": [600.0, 600.0], "principal_point": [320.0, 240.0]},
        {"f": 600.0, "cx": 320.0, "cy": 240.0},
    ],
)
def test_one_focal_length_counts_for_both_axes(tmp_path: Path, keys: dict[str, object]) -> None:
    (tmp_path / "camera.json").write_text(json.dumps(keys))
    camera = read_camera_file(tmp_path / "camera.json")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (600.0, 600.0, 320.0, 240.0)


@pytest.mark.parametrize("millimetres", [1.93, 50.0])
def test_a_focal_length_in_millimetres_is_not_taken_for_pixels(
    tmp_path: Path, millimetres: float
) -> None:
    keys = {"focal_length": millimetres, "cx": 320.0, "cy": 240.0}
    (tmp_path / "camera.json").write_text(json.dumps(keys))
    with pytest.raises(FormatError, match="lacks fx, fy"):
        read_camera_file(tmp_path / "camera.json")


def test_a_projection_with_a_baseline_is_refused(tmp_path: Path) -> None:
    right = np.column_stack([np.array(K), [-50.0, 0.0, 0.0]])
    np.save(tmp_path / "P.npy", right)
    with pytest.raises(FormatError, match=r"fourth column.*give that of the first camera"):
        read_camera_file(tmp_path / "P.npy")
    right[0, 3] = 0.0
    np.save(tmp_path / "P.npy", right)
    assert read_camera_file(tmp_path / "P.npy").fx == 60.0


def test_a_camera_of_another_size_is_refused_with_the_camera_of_this_size() -> None:
    color = CameraFile(900.0, 901.0, 479.5, 359.5, 960, 720)
    with pytest.raises(FormatError, match=r"--intrinsics 240,240\.267,127\.5,95\.5 if"):
        color.at(256, 192)
    with pytest.raises(FormatError, match=r"give the intrinsics of the depth image$"):
        color.at(640, 360)


@pytest.mark.parametrize("key", ["P", "projection_matrix"])
@pytest.mark.parametrize("stated", [[0.1, 0.2], np.diag([1.8, 2.5, -1.0, 0.0]).tolist()])
def test_a_projection_next_to_focal_lengths_is_none_of_a_camera(
    tmp_path: Path, key: str, stated: list[object]
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({"fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5, key: stated}))
    assert read_camera_file(path).fx == 60.0
