"""Organised clouds: the camera from the points, and clouds that fit no camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.lens import BROWN, Distortion, displacement
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.pcd import fit_camera
from pipelines.geometry.camera import Intrinsics
from tests.frames.layouts import build


@given(
    st.floats(40, 400), st.floats(40, 400), st.floats(5, 40), st.floats(5, 30), st.integers(0, 99)
)
def test_the_camera_is_computed_from_the_points(
    fx: float, fy: float, cx: float, cy: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.3, 3.0, (36, 48)) * (rng.random((36, 48)) > 0.3)
    points = Intrinsics(fx, fy, cx, cy, 48, 36).backproject(depth)
    camera = fit_camera(Path("x.pcd"), points)
    assert np.allclose([camera.fx, camera.fy, camera.cx, camera.cy], [fx, fy, cx, cy], rtol=1e-6)


@given(st.floats(-0.25, 0.25), st.floats(-0.1, 0.1), st.floats(-0.004, 0.004), st.integers(0, 99))
def test_the_lens_of_a_cloud_is_found_with_its_camera(
    k1: float, k2: float, p1: float, seed: int
) -> None:
    """Each point lies on the ray of its pixel in an image with lens distortion."""
    lens = (k1, k2, p1, -p1, 0.0)
    matrix = np.array([[60.0, 0.0, 24.0], [0.0, 61.0, 18.0], [0.0, 0.0, 1.0]])
    v, u = np.mgrid[:36, :48].astype(np.float64)
    pixels = np.stack([u, v], 2).reshape(-1, 2)
    rays = np.column_stack([(pixels - [24.0, 18.0]) / 60.0, np.ones(len(pixels))])
    for _ in range(100):  # to the rays that the lens shows in these pixels
        shown = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(lens))[0][:, 0]
        rays[:, :2] += (pixels - shown) / 60.0
    assert np.abs(shown - pixels).max() < 1e-6
    depth = np.random.default_rng(seed).uniform(300.0, 900.0, (36, 48, 1))
    camera = fit_camera(Path("x.pcd"), rays.reshape(36, 48, 3) * depth)
    fitted = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    again = np.array(camera.distortion.coefficients or np.zeros(5))
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), fitted, again)[0][:, 0]
    assert np.abs(seen - pixels).max() <= 0.5
    true = Intrinsics(60.0, 61.0, 24.0, 18.0, 48, 36)
    if displacement(true, Distortion(BROWN, lens)) > 3.0:
        assert np.allclose(fitted, matrix, atol=0.5)


def test_a_cloud_with_lens_distortion_gives_an_undistorted_frame(tmp_path: Path) -> None:
    points = build.cloud(0)
    slopes = np.stack([points["x"] / points["z"], points["y"] / points["z"]], 2)
    stretched = 1 + 0.2 * (slopes**2).sum(2)
    points["x"], points["y"] = points["x"] * stretched, points["y"] * stretched
    write(tmp_path / "x.pcd", points)
    frame = find_frames(tmp_path)[0].read()
    assert "lens distortion (Brown-Conrady) is removed" in frame.notes[0]
    again = frame.intrinsics.backproject(frame.depth)[frame.depth > 0]
    given = np.column_stack([points[axis].ravel() for axis in "xyz"])
    distance, _ = KDTree(given[np.isfinite(given).all(1)]).query(again)
    assert np.quantile(distance, 0.9) < 0.7 * np.median(again[:, 2]) / frame.intrinsics.fx


def write(path: Path, points: np.ndarray, **head: str) -> None:
    text = build.pcd_head("binary").decode()
    for key, value in head.items():
        text = "\n".join(
            f"{key} {value}" if line.startswith(f"{key} ") else line for line in text.split("\n")
        )
    path.write_bytes(text.encode() + points.tobytes())


def refusal(path: Path) -> str:
    with pytest.raises(FormatError, match=path.name) as caught:
        find_frames(path.parent)[0].read()
    return str(caught.value)


def test_a_turned_cloud_is_refused(tmp_path: Path) -> None:
    points = build.cloud(0)
    points["x"] += points["z"] * points["y"]
    write(tmp_path / "x.pcd", points)
    assert "pinhole" in refusal(tmp_path / "x.pcd")


def test_a_point_of_infinite_slope_is_refused() -> None:
    points = Intrinsics(60.0, 60.0, 24.0, 18.0, 48, 36).backproject(np.ones((36, 48)))
    points[3, 4] = 1e300, 0.0, 1e-300
    with pytest.raises(FormatError, match="pinhole"):
        fit_camera(Path("x.pcd"), points)


def test_a_list_of_points_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "x.pcd", build.cloud(0), WIDTH=str(48 * 36), HEIGHT="1")
    assert "organised" in refusal(tmp_path / "x.pcd")


def test_a_cut_off_cloud_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "x.pcd", build.cloud(0)[:20])
    assert "does not hold its points" in refusal(tmp_path / "x.pcd")


def test_a_cloud_that_claims_more_than_memory_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "x.pcd", build.cloud(0), WIDTH="99999999", HEIGHT="99999999")
    assert "99999999x99999999" in refusal(tmp_path / "x.pcd")


def test_missing_colour_is_replaced_by_grey_and_reported(tmp_path: Path) -> None:
    write(tmp_path / "x.pcd", build.cloud(0), FIELDS="x y z curvature")
    assert "grey" in find_frames(tmp_path)[0].read().notes[0]


def test_stated_intrinsics_win(tmp_path: Path) -> None:
    write(tmp_path / "x.pcd", build.cloud(0))
    camera = Intrinsics(70.0, 70.0, 24.0, 18.0, 48, 36)
    assert find_frames(tmp_path, FrameOptions(CameraFile.of(camera)))[0].read().intrinsics == camera
