"""Names of flat pairs: frames written under any name are read again."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.convert_frames import write_flat_pair
from pipelines.frames.frames import find_frames
from pipelines.frames.pairing.image_pairs import flat_pairs
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from tests.frames.layouts import build

CAMERA = Intrinsics(*build.FOUR, build.WIDTH, build.HEIGHT)
WORDS = st.sampled_from(["rgb", "color", "colour", "depth", "image", "1", "x", "RGB", "Depth"])
NAMES = st.builds(
    lambda words, mark: mark.join(words),
    st.lists(WORDS, min_size=1, max_size=3),
    st.sampled_from("_-."),
)


def frame(name: str, index: int) -> Frame:
    metres = build.depth(index) / np.float32(1000)
    return Frame(name, build.color(index), metres, CAMERA, 1000.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(NAMES, min_size=2, max_size=3, unique=True))
def test_frames_of_any_names_are_read_again(names: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        written = {name: frame(name, i) for i, name in enumerate(names)}
        for each in written.values():
            write_flat_pair(Path(folder), each)
        # A frame called `image` is written as image_color.png, and read under the folder's name.
        found = [source.read() for source in find_frames(Path(folder))]
        back = {"image" if each.name == Path(folder).name else each.name: each for each in found}
    assert sorted(back) == sorted(written)
    for name, each in written.items():
        assert_array_equal(back[name].color, each.color)
        assert_array_equal(back[name].depth, each.depth)


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (["rgb_1_color.png", "rgb_1_depth.png"], {"rgb_1": "rgb_1_color.png"}),
        (["depth_1_color.png", "depth_1_depth.png"], {"depth_1": "depth_1_color.png"}),
        (["x_color.png", "x_depth.png", "x_depth_color.png"], {"x": "x_color.png"}),
        (["color_1.png", "depth_1.png", "depth_1_color.png"], {"1": "color_1.png"}),
        (["color.png", "depth.png", "depth_color.png"], {"": "color.png"}),
        (
            ["x_color.png", "x_depth.png", "x_depth_color.png", "x_depth_depth.png"],
            {"x": "x_color.png", "x_depth": "x_depth_color.png"},
        ),
    ],
)
def test_the_last_word_of_a_name_gives_the_kind_of_a_file(
    tmp_path: Path, files: list[str], expected: dict[str, str]
) -> None:
    for file in files:
        (tmp_path / file).write_bytes(b"")
    pairs = flat_pairs(tmp_path)
    assert {pair.stem: pair.color and pair.color.name for pair in pairs} == expected
    assert all(pair.depth is not None and not pair.rivals for pair in pairs)
