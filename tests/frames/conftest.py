"""Small RGB-D frames in the layouts that users have."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

WIDTH, HEIGHT = 64, 48
CAMERA = {"fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5, "width": WIDTH, "height": HEIGHT}


@pytest.fixture(scope="session")
def color() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)


@pytest.fixture(scope="session")
def depth() -> np.ndarray:
    """Depth in millimetres with every kind of missing value of an integer file."""
    values = np.random.default_rng(1).integers(500, 900, (HEIGHT, WIDTH)).astype(np.uint16)
    values[0, :3] = (0, 65535, 700)
    return values


@pytest.fixture
def save(color: np.ndarray, depth: np.ndarray) -> Callable[..., None]:
    """Save a colour and a depth image, and a camera file, under the paths given."""

    def save_frame(color_path: Path, depth_path: Path | None, camera_path: Path | None) -> None:
        color_path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(color_path), color[:, :, ::-1])
        if depth_path is not None:
            depth_path.parent.mkdir(parents=True, exist_ok=True)
            if depth_path.suffix == ".npy":
                np.save(depth_path, np.where(depth == 65535, np.nan, depth / 1000.0))
            else:
                cv2.imwrite(str(depth_path), depth)
        if camera_path is not None:
            camera_path.write_text(json.dumps(CAMERA | {"depth_scale": 1000.0}))

    return save_frame


@pytest.fixture
def flat(tmp_path: Path, save: Callable[..., None]) -> Path:
    """A folder with the frames `a` and `b` in the project's layout."""
    for name in "ab":
        files = [tmp_path / f"{name}_{end}" for end in ("color.png", "depth.png", "camera.json")]
        save(*files)
    return tmp_path
