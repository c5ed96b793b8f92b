"""Colour that lies beside the depth is noticed; registered frames are left in peace."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.formats.frames import find_frames
from pipelines.formats.registration import color_offset, oddities
from pipelines.formats.rgbd import Frame
from pipelines.geometry.camera import Intrinsics

CAMERA = Intrinsics(300.0, 300.0, 160.0, 120.0, 320, 240)
BUNDLED = Path(__file__).resolve().parents[2] / "pipelines/weights/frames"


def boxes(seed: int, dx: int = 0, dy: int = 0) -> Frame:
    """Boxes of a colour each on a table; colour lies (dx, dy) pixels off."""
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
def test_frames_that_lie_right_are_left_in_peace(seed: int) -> None:
    assert color_offset(boxes(seed)) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([(12, 0), (-9, 4), (0, 14), (-16, -11)]))
def test_an_offset_is_measured(seed: int, offset: tuple[int, int]) -> None:
    found = color_offset(boxes(seed, *offset))
    assert found is not None
    assert max(abs(found[0] - offset[0]), abs(found[1] - offset[1])) <= 2


def test_without_edges_nothing_is_said() -> None:
    frame = boxes(0, 12)
    assert color_offset(replace(frame, color=np.full_like(frame.color, 128))) is None
    assert color_offset(replace(frame, depth=np.full_like(frame.depth, 0.7))) is None


def test_the_demos_frames_lie_right() -> None:
    for source in find_frames(BUNDLED):
        assert color_offset(source.read()) is None


def test_real_frames_lie_right_and_are_noticed_when_they_do_not(shared: Path) -> None:
    noticed = 0
    sources = [s for s in find_frames(shared / "frames") if "native" not in s.name][::3]
    for source in sources:
        frame = source.read()
        assert color_offset(frame) is None, source.name
        moved = replace(frame, color=np.roll(frame.color, (10, -30), (0, 1)))
        noticed += color_offset(moved) is not None
    assert noticed >= len(sources) / 2


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_sparse_depth_is_mentioned(share: float) -> None:
    frame = boxes(0)
    depth = frame.depth * (np.arange(240) < share * 240)[:, None]
    sentences = oddities(replace(frame, depth=depth.astype(np.float32), notes=("from afar",)))
    assert sentences[0] == "from afar"
    assert any("third" in sentence for sentence in sentences) == (share < 1 / 3)
