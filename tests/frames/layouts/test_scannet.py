"""ScanNet: colour of another size, mapped through the colour camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.scannet import seen_by
from pipelines.geometry.camera import Intrinsics
from tests.frames.layouts import build

SCALE = 2.025  # 1296 / 640


def smooth(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    """Return a camera's image of a wall whose colour changes with direction."""
    x, y, _one = np.moveaxis(Intrinsics(fx, fy, cx, cy, width, height).rays(), 2, 0)
    return (120 + 100 * np.stack([x, y, x * y], 2)).astype(np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    build.scannet(tmp_path)
    fx, fy, cx, cy = (SCALE * value for value in build.FOUR)
    full = np.eye(4)
    full[0, 0], full[1, 1], full[:2, 2] = fx, fy, (cx, cy)
    np.savetxt(tmp_path / "intrinsic/intrinsic_color.txt", full)
    for image in (tmp_path / "color").iterdir():
        cv2.imwrite(str(image), smooth(98, 73, fx, fy, cx, cy)[:, :, ::-1])
    return tmp_path


def test_colour_of_another_size_is_looked_up_through_both_cameras(folder: Path) -> None:
    frame = find_frames(folder)[0].read()
    expected = smooth(build.WIDTH, build.HEIGHT, *build.FOUR)
    assert frame.color.shape == expected.shape
    inside = (slice(0, -1), slice(0, -1))  # colour may end at the last pixels
    assert np.abs(frame.color[inside].astype(int) - expected[inside]).max() <= 2
    assert "98x73 is sampled" in frame.notes[0]
    assert frame.intrinsics.fx == build.FOUR[0]


def test_colour_without_its_camera_is_refused(folder: Path) -> None:
    (folder / "intrinsic/intrinsic_color.txt").unlink()
    with pytest.raises(FormatError, match="colour is 98x73, depth is 48x36"):
        find_frames(folder)[0].read()


def test_pixels_outside_the_colour_camera_are_black() -> None:
    color = np.full((36, 48, 3), 200, np.uint8)
    far = CameraFile(60.0, 60.0, 500.0, 500.0)
    assert not seen_by(color, far, Intrinsics(*build.FOUR, 48, 36)).any()


def test_depth_aligned_to_the_colour_has_the_camera_of_the_colour(tmp_path: Path) -> None:
    build.scannet(tmp_path)
    full = np.diag([70.0, 71.0, 1.0, 1.0])
    full[:2, 2] = 22.0, 16.0
    np.savetxt(tmp_path / "intrinsic/intrinsic_color.txt", full)
    (tmp_path / "depth").rename(tmp_path / "aligned_depth")
    (tmp_path / "depth").mkdir()
    for i in range(build.COUNT):
        build.image(tmp_path / f"depth/{i}.png", np.full((36, 48), 500, np.uint16))
    source = find_frames(tmp_path)[0]
    assert source.read().intrinsics == Intrinsics(70.0, 71.0, 22.0, 16.0, 48, 36)
    (tmp_path / "intrinsic/intrinsic_color.txt").unlink()
    with pytest.raises(FormatError, match="no intrinsics are known"):
        find_frames(tmp_path)[0].read()
