"""Removal of lens distortion from colour and depth, by OpenCV's models."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile, camera_from_mapping, read_camera_file
from pipelines.frames.cameras.lens import (
    BROWN,
    FISHEYE,
    Distortion,
    displacement,
    distorted,
    distortion_in,
    undistorted,
)
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import DepthUnits, make_frame
from pipelines.geometry.camera import Intrinsics
from tests.frames.layouts import build

CAMERA = Intrinsics(100.0, 101.0, 79.5, 59.5, 160, 120)
LENSES = [
    Distortion(BROWN, (-0.31, 0.12, 0.001, 0.002)),
    Distortion(BROWN, (-0.31, 0.12, 0.001, 0.0, 0.02)),
    Distortion(BROWN, (0.5, -2.3, 0.0006, -0.0002, 1.4, 0.38, -2.2, 1.3)),  # Azure Kinect's
    Distortion(FISHEYE, (0.1, -0.02, 0.01, -0.002)),
]
NAMED = {"fx": 60.0, "fy": 61.0, "cx": 23.5, "cy": 17.5}


def bent(ray: np.ndarray, lens: Distortion) -> tuple[float, float]:
    """Return where a lens shows a ray (x, y), by the formulas of OpenCV's documentation."""
    x, y = ray
    r2 = x * x + y * y
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.coefficients, 0, 0, 0, 0, 0)[:8]
    if lens.model == FISHEYE:
        r = np.sqrt(r2)
        t = np.arctan(r)
        factor = t * (1 + k1 * t**2 + k2 * t**4 + p1 * t**6 + p2 * t**8) / r
        return x * factor, y * factor
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    sideways = 2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return x * radial + sideways[0], y * radial + sideways[1]


@pytest.mark.parametrize("lens", LENSES)
def test_each_pixel_takes_the_place_where_the_lens_shows_its_ray(lens: Distortion) -> None:
    rows, columns = np.mgrid[:120, :160].astype(np.float32)
    taken = np.stack([columns, rows], -1)
    moved = undistorted(taken, CAMERA, lens, smooth=True)
    for u, v in [(30, 40), (80, 60), (120, 95), (60, 20)]:
        ray = np.array([(u - 79.5) / 100.0, (v - 59.5) / 101.0])
        place = moved[v, u]
        seen = (place - (79.5, 59.5)) / (100.0, 101.0)
        np.testing.assert_allclose(seen, bent(ray, lens), atol=1e-3)


def test_librealsenses_inverse_model_leads_from_rays_to_pixels_too() -> None:
    coefficients = [-0.0565, 0.0682, 0.0004, 0.0007, -0.0218]  # a D455's
    content = NAMED | {"model": "distortion.inverse_brown_conrady", "coeffs": coefficients}
    distortion = camera_from_mapping(Path("camera.json"), content).distortion
    columns = np.arange(160, dtype=np.float32) * np.ones((120, 1), np.float32)
    place = undistorted(columns, CAMERA, distortion, smooth=True)[60, 150]
    x, y = (150 - 79.5) / 100.0, (60 - 59.5) / 101.0
    seen, _ = bent(np.array([x, y]), Distortion(BROWN, tuple(coefficients)))
    assert place == pytest.approx(79.5 + 100.0 * seen, abs=0.05)


@pytest.mark.parametrize("lens", LENSES)
def test_an_image_with_distortion_gives_the_same_image_without_it(lens: Distortion) -> None:
    rows, columns = np.mgrid[:120, :160]
    ids = np.where(np.hypot(rows - 40, columns - 110) < 25, 7, 1).astype(np.int32)
    back = undistorted(distorted(ids, CAMERA, lens), CAMERA, lens, smooth=False)
    seen = back > 0
    assert seen.mean() > 0.8
    assert np.mean(back[seen] == ids[seen]) > 0.995
    wide = Distortion(BROWN, (0.3,))  # spreads pixels out: no pixel between is left empty
    assert distorted(ids, CAMERA, wide)[30:50, 100:120].min() == 7


def test_undistorted_depth_has_only_measured_values() -> None:
    depth = np.where(np.arange(160) < 80, 0.5, 0.9).astype(np.float32) * np.ones(
        (120, 1), np.float32
    )
    moved = undistorted(depth, CAMERA, Distortion(BROWN, (0.2, 0.1)), smooth=False)
    assert set(np.unique(moved)) == {0.0, np.float32(0.5), np.float32(0.9)}


def test_pixels_beyond_the_turn_of_the_polynomial_are_missing() -> None:
    wide = Intrinsics(60.0, 60.0, 79.5, 59.5, 160, 120)
    ones = np.ones((120, 160), np.float32)
    moved = undistorted(ones, wide, Distortion(BROWN, (-0.5, 0.0)), smooth=False)
    assert moved[60, 80] == 1.0
    assert moved[0, 0] == 0.0  # r = 1.6; r - 0.5 r^3 falls from r = 0.82 on


def test_distortion_below_half_a_pixel_is_not_removed() -> None:
    assert displacement(CAMERA, Distortion(BROWN, (1e-4, 0.0))) == 0.0
    assert displacement(CAMERA, Distortion()) == 0.0
    assert displacement(CAMERA, LENSES[0]) > 10.0


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"D": [0.1, 0.2, 0.0, 0.0, 0.0]}, Distortion(BROWN, (0.1, 0.2))),
        ({"D": [0.0] * 5, "distortion_model": "plumb_bob"}, Distortion()),
        ({"D": [0.1], "distortion_model": "equidistant"}, Distortion(FISHEYE, (0.1,))),
        ({"distortion_coefficients": {"rows": 1, "cols": 2, "data": [0.1, 0.2]}},
         Distortion(BROWN, (0.1, 0.2))),
        ({"k1": 0.1, "k2": None, "p2": 0.4}, Distortion(BROWN, (0.1, 0.0, 0.0, 0.4))),
        ({"k1": 0.1, "k4": 0.4, "camera_model": "OPENCV_FISHEYE"},
         Distortion(FISHEYE, (0.1, 0.0, 0.0, 0.4))),
        ({"coeffs": [0.1], "model": "distortion.inverse_brown_conrady"},
         Distortion(BROWN, (0.1,))),
        ({"D": [0.1], "model": "D435"}, Distortion(BROWN, (0.1,))),
        ({"D": [0.9], "distortion_model": "fov"}, Distortion("fov", (0.9,))),
        ({"k1": 0.9, "camera_model": "double_sphere"}, Distortion("double_sphere", (0.9,))),
        ({"k1": 0.9, "camera_model": "THIN_PRISM_FISHEYE"},
         Distortion("THIN_PRISM_FISHEYE", (0.9,))),
        ({"D": [0.9], "model": "RADIAL_FISHEYE"}, Distortion("RADIAL_FISHEYE", (0.9,))),
        ({"coeffs": [0.9], "model": "distortion.ftheta"}, Distortion("distortion.ftheta", (0.9,))),
        ({"k1": 0.1, "camera_model": "SIMPLE_RADIAL"}, Distortion(BROWN, (0.1,))),
        ({"k1": 0.0, "camera_model": "double_sphere"}, Distortion()),
        ({"distortion": {"model": "radtan", "coefficients": [0.1, -0.2, 0, 0, 0]}},
         Distortion(BROWN, (0.1, -0.2))),
        ({"distortion": {"model": "equidistant", "coeffs": [0.1]}, "camera_model": "pinhole"},
         Distortion(FISHEYE, (0.1,))),
        ({"distortion": {"model": "ds", "data": [0.1]}}, Distortion("ds", (0.1,))),
        ({"distortion": {"model": "radtan"}, "coeffs": [0.1]}, Distortion(BROWN, (0.1,))),
        ({"data": [1.0, 2.0], "fx": 1.0}, Distortion()),
        ({"distortion": "none", "fx": 1.0}, Distortion()),
        ({"distortion": "radtan", "dist": 0, "D": ""}, Distortion()),
    ],
)  # fmt: skip
def test_the_distortion_keys_of_many_tools_are_known(content: dict, expected: Distortion) -> None:
    assert distortion_in(Path("camera.json"), content) == expected


@pytest.mark.parametrize("D", [[float("nan"), 0.1], [0.1] * 15, ["wide"], [[0.1], [0.2, 0.3]]])
def test_impossible_coefficients_are_reported_in_one_sentence(D: list) -> None:
    with pytest.raises(FormatError, match=r"camera\.json"):
        camera_from_mapping(Path("camera.json"), NAMED | {"D": D})


@pytest.mark.parametrize("stated", ["0.1 -0.2 0 0", 0.1, (0.1, -0.2)])
def test_coefficients_that_are_no_list_are_refused_and_not_ignored(stated: object) -> None:
    with pytest.raises(
        FormatError, match=r"states distortion coefficients as .* a list of numbers"
    ):
        camera_from_mapping(Path("camera.json"), NAMED | {"dist_coeffs": stated})
    with pytest.raises(FormatError, match="a list of numbers"):
        camera_from_mapping(Path("camera.json"), NAMED | {"distortion": {"data": stated}})


def test_a_yaml_of_ros_has_its_distortion(tmp_path: Path) -> None:
    path = tmp_path / "camera_info.yaml"
    path.write_text(
        "distortion_model: rational_polynomial\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 8\n  data: [1, 2, 3, 4, 5, 6, 7, 8]\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [60, 0, 23, 0, 61, 17, 0, 0, 1]\n"
    )
    assert read_camera_file(path).distortion == Distortion(BROWN, (1, 2, 3, 4, 5, 6, 7, 8))


def framed(lens: Distortion, depth: np.ndarray):
    camera = CameraFile(100.0, 101.0, 79.5, 59.5, distortion=lens)
    color = np.full((*depth.shape, 3), 9, np.uint8)
    parts = (Path("c.png"), lambda: color), (Path("d.png"), depth)
    return make_frame(*parts, camera, DepthUnits())


def test_a_frame_notes_its_removed_distortion_and_masks_are_moved_along() -> None:
    depth = np.full((120, 160), 700, np.uint16)
    frame = framed(LENSES[0], depth)
    assert "lens distortion (Brown-Conrady) is removed" in frame.notes[0]
    mask = np.zeros((120, 160), np.bool_)
    mask[20:24, 20:24] = True
    rows, columns = np.nonzero(frame.undistorted(mask))
    assert rows.mean() < 19  # barrel distortion draws points towards the middle
    assert columns.mean() < 19
    assert frame.undistorted(np.full((120, 160), 3, np.int32))[60, 80] == 3
    plain = framed(Distortion(), depth)
    assert not plain.notes
    assert plain.undistorted(mask) is mask


def test_an_unknown_model_is_reported() -> None:
    frame = framed(Distortion("fov", (0.9,)), np.full((120, 160), 700, np.uint16))
    assert frame.notes == ("the lens distortion is of the unknown model fov and stays",)


@pytest.mark.parametrize("values", [[0.1, -0.2], [[0.1], [-0.2]]])
def test_distortion_under_a_name_that_is_not_read_is_reported(
    tmp_path: Path, values: list[object]
) -> None:
    build.flat(tmp_path)
    for path in tmp_path.glob("*.json"):
        path.write_text(json.dumps(NAMED | {"radial_distortion": values}))
    note = "the lens distortion is of the unknown model radial_distortion and stays"
    assert find_frames(tmp_path)[0].read().notes == (note,)
    for path in tmp_path.glob("*.json"):
        path.write_text(json.dumps(NAMED | {"radial_distortion": [0, 0.0]}))
    assert find_frames(tmp_path)[0].read().notes == ()


def test_every_layout_with_a_camera_file_is_undistorted(tmp_path: Path) -> None:
    build.nerfstudio(tmp_path / "n")
    build.flat(tmp_path / "f")
    index = tmp_path / "n/transforms.json"
    index.write_text(json.dumps(json.loads(index.read_text()) | {"k1": -0.3}))
    for path in (tmp_path / "f").glob("*.json"):
        path.write_text(json.dumps(NAMED | {"D": [-0.3, 0.0]}))
    frames = [source.read() for source in find_frames(tmp_path)]
    assert [frame.removed for frame in frames] == [Distortion(BROWN, (-0.3,))] * 4
    assert (frames[0].depth == frames[2].depth).all()


def test_the_shared_case_is_undistorted(shared: Path) -> None:
    case = shared / "cases/lens_distortion"
    frame = find_frames(case)[0].read()
    assert frame.removed == Distortion(BROWN, (-0.31, 0.12, 0.001))
    taken = cv2.imread(str(case / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert 0.8 * np.count_nonzero(taken) < np.count_nonzero(frame.depth)
