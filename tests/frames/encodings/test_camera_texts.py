"""Cameras in text files and in OpenCV's XML and YAML."""

from pathlib import Path

import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import read_camera_file, read_units
from pipelines.frames.cameras.camera_search import find_camera_file
from pipelines.frames.cameras.lens import BROWN, FISHEYE

FOUR = (600.0, 601.0, 320.0, 240.0)
MATRIX = "600. 0. 320. 0. 601. 240. 0. 0. 1."
LENS = (0.1, -0.2)
OPENCV_XML = f"""<?xml version="1.0"?>
<opencv_storage>
<image_Width>640</image_Width>
<image_Height>480</image_Height>
<Camera_Matrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt>
  <data>
    {MATRIX}</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix">
  <rows>5</rows><cols>1</cols><dt>d</dt>
  <data>
    1.0e-01 -2.0e-01 0. 0. 0.</data></Distortion_Coefficients>
</opencv_storage>
"""
OPENCV_YAML = f"""%YAML:1.0
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {MATRIX.replace(" ", ", ")} ]
dist_coeff: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 1.0e-01, -2.0e-01, 0., 0., 0. ]
"""
ORB_SLAM = """%YAML:1.0
Camera.type: "PinHole"
Camera.fx: 600.0
Camera.fy: 601.0
Camera.cx: 320.0
Camera.cy: 240.0
Camera.k1: 0.1
Camera.k2: -0.2
Camera.p1: 0.0
Camera.p2: 0.0
"""
COLMAP = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, ...\n"
ONE = "1 PINHOLE 640 480 600 601 320.5 240.5\n"
# File name, content, model and coefficients of the lens.
FORMS = [
    ("a.txt", "fx=600 fy=601 cx=320 cy=240", BROWN, ()),
    ("a.txt", "Colour camera\nfx: 600\nfy: 601\ncx: 320\ncy: 240  # pixels\n", BROWN, ()),
    ("a.txt", "fx = 600, fy = 601, cx = 320, cy = 240, k1 = 0.1, k2 = -0.2", BROWN, LENS),
    ("a.txt", "K = [[600, 0, 320],\n [0, 601, 240],\n [0, 0, 1]]\nD: 0.1 -0.2 0 0 0", BROWN, LENS),
    ("a.txt", "[[600 0 320]\n [0 601 240]\n [0 0 1]]", BROWN, ()),
    ("a.txt", "fx 600\nfy 601\ncx 320\ncy 240\n", BROWN, ()),
    ("a.txt", '{"fx": 600, "fy": 601, "cx": 320, "cy": 240}', BROWN, ()),
    ("a.csv", "fx,fy,cx,cy\n600,601,320,240\n", BROWN, ()),
    ("a.csv", "600,0,320\n0,601,240\n0,0,1\n", BROWN, ()),
    ("cameras.txt", COLMAP + ONE, BROWN, ()),
    ("cameras.txt", ONE + ONE.replace("1", "2", 1), BROWN, ()),
    ("cameras.txt", "1 OPENCV 640 480 600 601 320.5 240.5 0.1 -0.2 0 0", BROWN, LENS),
    ("cameras.txt", "7 OPENCV_FISHEYE 640 480 600 601 320.5 240.5 0.1 -0.2 0 0", FISHEYE, LENS),
    ("calibration.xml", OPENCV_XML, BROWN, LENS),
    ("calibration.yml", OPENCV_YAML, BROWN, LENS),
    ("orb.yaml", ORB_SLAM, BROWN, LENS),
    ("orb.yaml", ORB_SLAM.replace("PinHole", "KannalaBrandt8"), FISHEYE, LENS),
]


@pytest.mark.parametrize(("name", "text", "model", "lens"), FORMS)
def test_a_camera_in_a_text_is_found_and_read(
    tmp_path: Path, name: str, text: str, model: str, lens: tuple[float, ...]
) -> None:
    (tmp_path / name).write_text(text)
    found = find_camera_file(tmp_path, "x")
    assert found == tmp_path / name
    camera = read_camera_file(found)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == FOUR
    assert (camera.width, camera.height) in ((640, 480), (None, None))
    assert camera.distortion.coefficients == lens
    assert camera.distortion.model == model or not lens


def test_one_focal_length_of_colmap_is_that_of_both_sides(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text("1 SIMPLE_RADIAL 640 480 600 320.5 240.5 0.1")
    camera = read_camera_file(tmp_path / "c.txt")
    assert (camera.fx, camera.fy, camera.cx, camera.width) == (600.0, 600.0, 320.0, 640)
    assert camera.distortion.coefficients == (0.1,)


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("a.txt", "fx: 600\nfy: 601\n", "lacks cx, cy"),
        ("a.txt", "color\nfx: 600\ndepth\nfx: 500\n", "two values of fx.*--intrinsics"),
        ("a.txt", ONE + ONE.replace("600", "610"), "2 different cameras.*--intrinsics"),
        ("a.txt", "1 FOV 640 480 600 601 320 240 0.2", "model FOV; SIMPLE_PINHOLE, PINHOLE"),
        ("a.txt", "1 PINHOLE 640 480 600 601", "PINHOLE 640 480 600 601; width height fx fy"),
        ("a.xml", "<annotation><name>x</name></annotation>", "root `annotation`"),
        ("a.xml", "<opencv_storage><Camera_Matrix>", "cannot be read as XML"),
        (
            "a.xml",
            '<!DOCTYPE r [<!ENTITY a "x">]><opencv_storage>&a;</opencv_storage>',
            "cannot be read as XML",
        ),
    ],
)
def test_other_texts_are_refused_in_one_sentence_and_state_no_unit(
    tmp_path: Path, name: str, text: str, found: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=found):
        read_camera_file(tmp_path / name)
    assert read_units(tmp_path / name) is None  # so that --intrinsics is of use


def test_the_unit_of_the_depth_in_a_text_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("fx=600 fy=601 cx=320 cy=240\ndepth_scale=5000\n")
    assert read_camera_file(tmp_path / "a.txt").units_per_metre == 5000.0
    assert read_units(tmp_path / "a.txt") == 5000.0
