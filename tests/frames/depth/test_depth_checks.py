"""Depth values that are not distances, detected by their geometry."""

from pathlib import Path

import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import parse_camera
from pipelines.frames.depth.depth_checks import (
    LOOKS_INVERSE,
    SWAPPED,
    depth_oddities,
    has_rotated_bits,
)
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import DepthUnits, read_depth
from pipelines.geometry.camera import Intrinsics
from pipelines.storage.images import write_image

LENS = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
RAYS = LENS.rays()


def table(tilt: float, *, sensor_noise: float = 0.002) -> np.ndarray:
    """A table at 0.7 m, tilted by `tilt` radians, with three boxes of 10 cm on it; metres."""
    normal = np.array([0.0, -np.sin(tilt), -np.cos(tilt)])
    depth = -0.7 * np.cos(tilt) / (RAYS @ normal)
    top = -(0.7 * np.cos(tilt) - 0.06) / (RAYS @ normal)
    for u, v in ((70, 90), (150, 150), (240, 100)):
        box = np.s_[v - 20 : v + 20, u - 20 : u + 20]
        depth[box] = top[box]
    noise = np.random.default_rng(0).normal(size=depth.shape)
    return (depth * (1.0 + sensor_noise * noise)).astype(np.float32)


def warnings_of(depth: np.ndarray) -> list[str]:
    return depth_oddities(depth.astype(np.float32), LENS.fx)


@pytest.mark.parametrize("tilt", [0.1, 0.5, 0.8])
def test_depth_of_a_table_is_accepted_and_its_inverse_is_reported(tilt: float) -> None:
    depth = table(tilt)
    assert warnings_of(depth) == []
    assert warnings_of(1.0 / depth) == [LOOKS_INVERSE]
    assert warnings_of(40.0 / depth / 100.0) == [LOOKS_INVERSE]  # disparity in another unit


def test_inverse_depth_from_straight_above_is_reported_as_near_and_far_swapped() -> None:
    assert warnings_of(table(0.0)) == []
    assert warnings_of(1.0 / table(0.0)) == [SWAPPED]
    assert warnings_of(1.5 - table(0.0)) == [SWAPPED]


@pytest.mark.parametrize(("scale", "size"), [(8.0, "0.7"), (0.1, "0.0087")])
def test_another_unit_is_detected_by_the_size_of_objects(scale: float, size: str) -> None:
    (sentence,) = warnings_of(scale * table(0.4))
    assert f"{size} m wide" in sentence
    assert "--depth-units-per-metre" in sentence


def test_steps_of_eight_bits_are_reported() -> None:
    coarse = np.round(table(0.4) / 4.0 * 255) / 255 * 4.0
    assert any("steps of 16 mm" in sentence for sentence in warnings_of(coarse))
    assert not any("steps" in sentence for sentence in warnings_of(np.round(table(0.4), 3)))


@pytest.mark.parametrize("depth", [np.zeros((40, 60)), np.ones((1, 1)), np.eye(50)])
def test_nothing_is_reported_where_little_is_measured(depth: np.ndarray) -> None:
    assert warnings_of(depth) == []


def test_saturated_depth_is_reported(tmp_path: Path) -> None:
    depth = np.zeros((20, 30), np.uint16)
    depth[:, :15] = 65535
    write_image(tmp_path / "d.png", depth)
    with pytest.raises(FormatError, match=r"50% of the pixels are 65535.*saturated"):
        read_depth(tmp_path / "d.png", DepthUnits())
    write_image(tmp_path / "d.png", np.zeros((20, 30), np.uint16))
    with pytest.raises(FormatError, match="measure again"):
        read_depth(tmp_path / "d.png", DepthUnits())


def test_disparity_beyond_the_range_is_not_taken_for_another_unit(tmp_path: Path) -> None:
    write_image(tmp_path / "d.png", np.round(50.0 / table(0.5)).astype(np.uint16))
    with pytest.raises(FormatError, match="inverse depth or disparity"):
        read_depth(tmp_path / "d.png", DepthUnits())


@pytest.mark.parametrize("far", [1e10, 2**32 - 1])
def test_depth_beyond_every_room_is_missing(tmp_path: Path, far: float) -> None:
    stored = table(0.4).astype(np.float64)
    stored[:9] = far
    np.save(tmp_path / "x.npy", stored)
    depth = read_depth(tmp_path / "x.npy", DepthUnits())
    assert (depth[:9] == 0).all()
    assert (depth[9:] > 0).all()


def test_one_depth_of_many_pixels_far_behind_all_others_is_reported() -> None:
    depth = table(0.4)
    depth[:1] = 4.095
    assert warnings_of(depth) == []
    depth[:9] = 4.095
    (sentence,) = warnings_of(depth)
    assert "4.095 m" in sentence
    assert "save 0" in sentence


def test_negative_depth_is_reported_as_such(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", -table(0.4))
    with pytest.raises(FormatError, match=r"100% of the depths are below 0.*positive"):
        read_depth(tmp_path / "x.npy", DepthUnits())


def test_the_shared_cases_are_reported(shared: Path) -> None:
    cases = shared / "cases"
    frame = find_frames(cases / "inverse_depth")[0].read()
    assert depth_oddities(frame.depth, frame.intrinsics.fx) == [LOOKS_INVERSE]
    camera = parse_camera("540,540,480,270")
    with pytest.raises(FormatError, match=r"66% of the pixels are 65535.*saturated"):
        find_frames(cases / "mask_as_depth", FrameOptions(camera))[0].read()
    depth = find_frames(cases / "lens_distortion")[0].read().depth
    assert depth_oddities(depth, 463.6) == []


def saved(folder: Path, stored: np.ndarray) -> Path:
    write_image(folder / "0_color.png", np.zeros((*stored.shape, 3), np.uint8))
    write_image(folder / "0_depth.png", stored)
    return folder


@pytest.mark.parametrize("distance", [1.0, 0.6])
def test_rotated_bits_of_sun_rgbd_are_refused_instead_of_read_as_eight_times_as_far(
    tmp_path: Path, distance: float
) -> None:
    millimetres = np.round(1000 * distance * table(0.4)).astype(np.uint16)
    millimetres[:3] = 8193 + 2 * np.arange(320)  # whose first bits wrap around
    saved(tmp_path, (millimetres << 3) | (millimetres >> 13))
    camera = parse_camera("300,300,159.5,119.5")
    with pytest.raises(FormatError, match=r"multiples of 8.*--depth-units-per-metre 8000"):
        find_frames(tmp_path, FrameOptions(camera))[0].read()
    frame = find_frames(tmp_path, FrameOptions(camera, 8000.0))[0].read()
    np.testing.assert_allclose(frame.depth[3:], millimetres[3:] / 1000, atol=1e-6)


def test_depth_of_few_values_or_of_wider_steps_has_no_rotated_bits() -> None:
    for step, count in ((8, 20), (16, 500), (1, 500)):
        values = 800 + step * np.arange(count, dtype=np.float32)
        assert not has_rotated_bits(np.tile(values, (30, 1)))
    assert not has_rotated_bits(np.arange(500_000, 900_000, 1000, dtype=np.float32))  # micrometres


def test_a_renderers_depth_buffer_gets_a_remark() -> None:
    near, far = 0.05, 5.0
    buffer = far / (far - near) - far * near / ((far - near) * table(0.4))
    assert any("depth buffer" in sentence for sentence in warnings_of(buffer))
    assert warnings_of(table(0.0) + 0.25) == []  # from straight above, some of it beyond 1 m


@pytest.mark.parametrize(
    ("other", "advice"),
    [
        ("0_depth.npy", "remove it, so that 0_depth.npy is read"),
        ("0_depth.raw", "save 0_depth.raw as a 16-bit PNG of one channel"),
        ("1_depth.npy", "save the raw depth as a 16-bit PNG of one channel"),
    ],
)
def test_the_depth_next_to_a_picture_of_it_is_named(
    tmp_path: Path, other: str, advice: str
) -> None:
    write_image(tmp_path / "0_color.png", np.zeros((40, 60, 3), np.uint8))
    (tmp_path / other).write_bytes(b"")
    for picture in (np.zeros((40, 60, 3), np.uint8), np.zeros((40, 60), np.uint8)):
        write_image(tmp_path / "0_depth.png", picture)
        with pytest.raises(FormatError, match=advice):
            find_frames(tmp_path)[0].read()


def test_depth_in_centimetres_is_refused_with_its_unit(tmp_path: Path) -> None:
    np.save(tmp_path / "0_depth.npy", 100 * table(0.4))
    write_image(tmp_path / "0_color.png", np.zeros((240, 320, 3), np.uint8))
    with pytest.raises(FormatError, match=r"0\.\d+ m under 100\b"):
        find_frames(tmp_path, FrameOptions(parse_camera("300,300,159.5,119.5")))[0].read()
