"""Organised clouds: the camera from the points, and clouds that fit no camera."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.errors import FormatError
from pipelines.frames.camera_files import CameraFile
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.pcd import fit_camera
from pipelines.frames.rgbd_folder import FrameOptions
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
