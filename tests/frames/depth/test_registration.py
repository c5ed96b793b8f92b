"""Detection of colour that is offset from the depth; registered frames give no warning."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.frames.depth import registration
from pipelines.frames.depth.registration import (
    CHANGE_WINDOW,
    FARTHEST,
    _color_changes,
    _match_at_offsets,
    color_offset,
    oddities,
)
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics

CAMERA = Intrinsics(300.0, 300.0, 160.0, 120.0, 320, 240)
BUNDLED = Path(__file__).resolve().parents[3] / "pipelines/weights/frames"


def boxes(seed: int, dx: int = 0, dy: int = 0) -> Frame:
    """Boxes of one colour each on a table; the colour image is (dx, dy) pixels off."""
    rng = np.random.default_rng(seed)
    depth = np.full((240, 320), 0.9, np.float32)
    color = np.full((240, 320, 3), 90, np.uint8)
    for _ in range(8):
        y, x = rng.integers(40, 160), rng.integers(40, 240)
        depth[y : y + 30, x : x + 40] = rng.uniform(0.6, 0.8)
        color[y : y + 30, x : x + 40] = rng.integers(0, 255, 3)
    noise = rng.integers(-8, 8, color.shape)
    color = np.clip(color.astype(int) + noise, 0, 255).astype(np.uint8)
    return Frame("boxes", np.roll(color, (dy, dx), (0, 1)), depth, CAMERA)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_registered_frames_give_no_warning(seed: int) -> None:
    assert color_offset(boxes(seed)) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([(12, 0), (-9, 4), (0, 14), (-16, -11)]))
def test_an_offset_is_measured(seed: int, offset: tuple[int, int]) -> None:
    found = color_offset(boxes(seed, *offset))
    assert found is not None
    assert max(abs(found[0] - offset[0]), abs(found[1] - offset[1])) <= 2


def test_frames_without_edges_give_no_warning() -> None:
    frame = boxes(0, 12)
    assert color_offset(replace(frame, color=np.full_like(frame.color, 128))) is None
    assert color_offset(replace(frame, depth=np.full_like(frame.depth, 0.7))) is None


@pytest.mark.parametrize("shape", [(1, 640), (2, 640), (1, 1280), (5, 1280), (640, 1), (1, 1)])
def test_a_narrow_strip_gives_no_warning(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    color = rng.integers(0, 255, (*shape, 3), dtype=np.uint8)
    depth = rng.uniform(0.4, 1.5, shape).astype(np.float32)
    assert oddities(Frame("strip", color, depth, CAMERA)) == ()


def test_the_frames_of_the_demo_are_registered() -> None:
    for source in find_frames(BUNDLED):
        assert color_offset(source.read()) is None


def test_real_frames_are_registered_and_an_offset_is_detected(shared: Path) -> None:
    noticed = 0
    sources = [s for s in find_frames(shared / "frames") if "native" not in s.name][::3]
    for source in sources:
        frame = source.read()
        assert color_offset(frame) is None, source.name
        moved = replace(frame, color=np.roll(frame.color, (10, -30), (0, 1)))
        noticed += color_offset(moved) is not None
    assert noticed >= len(sources) / 2


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_sparse_depth_gives_a_warning(share: float) -> None:
    frame = boxes(0)
    depth = frame.depth * (np.arange(240) < share * 240)[:, None]
    sentences = oddities(replace(frame, depth=depth.astype(np.float32), notes=("from afar",)))
    assert sentences[0] == "from afar"
    assert any("third" in sentence for sentence in sentences) == (share < 1 / 3)


def test_the_change_of_colour_is_the_length_of_its_gradient() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (240, 320), dtype=np.uint8)
    noise[60:120, 80:160] = noise[60:120, 80:160] // 128 * 255  # the steepest slopes there are
    dx, dy = (cv2.Sobel(noise, cv2.CV_32F, *axes) for axes in ((1, 0), (0, 1)))
    lengths = np.log1p(np.hypot(dx, dy))
    expected = lengths - cv2.blur(lengths, (CHANGE_WINDOW, CHANGE_WINDOW))
    frame = replace(boxes(0), color=np.repeat(noise[:, :, None], 3, axis=2))
    assert_array_equal(_color_changes(frame, 1), expected)


def test_a_match_is_the_mean_over_the_jumps() -> None:
    rng = np.random.default_rng(0)
    changes = rng.random((60, 80)).astype(np.float32)
    jumps = (rng.random((60, 80)) > 0.98).astype(np.float32)
    padded = np.pad(changes, FARTHEST)
    for y, x in ((0, 0), (FARTHEST, FARTHEST), (2 * FARTHEST, 3)):
        there = padded[y : y + 60, x : x + 80][jumps > 0]
        assert_allclose(_match_at_offsets(changes, jumps)[y, x], there.mean(), rtol=1e-5)


def test_many_jumps_are_matched_piece_by_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    changes, jumps = rng.random((2, 60, 80)).astype(np.float32)
    whole = _match_at_offsets(changes, jumps)
    monkeypatch.setattr(registration, "AT_A_TIME", 7)
    assert_allclose(_match_at_offsets(changes, jumps), whole, rtol=1e-6)


def test_noise_takes_no_more_memory_than_a_piece() -> None:
    changes = np.zeros((240, 320), np.float32)
    tracemalloc.start()
    _match_at_offsets(changes, np.ones_like(changes))
    assert tracemalloc.get_traced_memory()[1] < 2e8  # bytes; all offsets of all pixels take 5e8
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("size", "center"),
    [((848, 480), (640.0, 360.0)), ((848, 480), (320.0, 240.0)), ((480, 640), (320.0, 240.0))],
)
def test_a_camera_of_another_image_size_or_of_the_turned_image_is_reported(
    size: tuple[int, int], center: tuple[float, float]
) -> None:
    depth = np.zeros(size[::-1], np.float32)
    frame = Frame(
        "x", np.zeros((*depth.shape, 3), np.uint8), depth, Intrinsics(600, 600, *center, *size)
    )
    assert any("principal point" in sentence for sentence in oddities(frame))
    middle = Intrinsics(600, 600, 0.52 * size[0], 0.48 * size[1], *size)
    assert not any(
        "principal" in sentence for sentence in oddities(replace(frame, intrinsics=middle))
    )


def test_bundled_frames_get_no_remark() -> None:
    frames = find_frames(BUNDLED)
    assert len(frames) == 4
    for frame in frames:
        assert not oddities(frame.read()), frame.name
