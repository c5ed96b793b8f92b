"""OpenEXR depth: half and float, one channel or three, damaged files."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from numpy.testing import assert_allclose

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.encodings import exr_files
from pipelines.frames.encodings.exr_files import read_exr
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build

METRES = build.depth(0).astype(np.float32) / 1000


def write(path: Path, **channels: np.ndarray) -> Path:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
    return path


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("names", ["Z", "Y", "R", "RGB", "RGBA"])
def test_depth_is_read_from_any_channel(tmp_path: Path, kind: type, names: str) -> None:
    depth = METRES.astype(kind)
    channels = {name: np.ones_like(depth) if name == "A" else depth for name in names}
    assert_allclose(read_exr(write(tmp_path / "d.exr", **channels)), depth)


# Layers of a renderer: a colour, a normal and a position, whose channels all differ.
LAYERS = {
    layer + axis: (METRES + scale) * (i + 1)
    for layer, axes, scale in (("Image.", "RGB", 0.1), ("Normal.", "XYZ", 0.2), ("P.", "XYZ", 0.3))
    for i, axis in enumerate(axes)
}


@pytest.mark.parametrize("name", ["Depth.V", "View.Depth.Z", "depth", "Z", "View.Z"])
def test_depth_is_read_next_to_colour_normals_and_positions(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "d.exr", **LAYERS, **{name: METRES})
    assert_allclose(read_exr(path), METRES)


@pytest.mark.parametrize("names", [("Normal.X", "Normal.Y", "Normal.Z"), ("Y", "RY", "BY")])
def test_normals_and_luminance_are_not_depth(tmp_path: Path, names: tuple[str, ...]) -> None:
    channels = {name: METRES + i for i, name in enumerate(names)}
    assert read_exr(write(tmp_path / "d.exr", **channels)).shape == (*METRES.shape, 3)


def test_luminance_without_a_layer_is_depth_next_to_layers(tmp_path: Path) -> None:
    assert_allclose(read_exr(write(tmp_path / "d.exr", **LAYERS, Y=METRES)), METRES)


def test_empty_channels_next_to_the_depth_are_ignored(tmp_path: Path) -> None:
    empty = np.zeros_like(METRES)
    assert_allclose(read_exr(write(tmp_path / "d.exr", R=METRES, G=empty, B=empty)), METRES)


def test_a_frame_whose_names_contain_other_words_has_exr_depth(tmp_path: Path) -> None:
    build.image(tmp_path / "7-glass-rgb-img.jpg", build.color(0))
    write(tmp_path / "7-glass-depth-img.exr", R=METRES, G=METRES, B=METRES)
    camera = dict(zip(("fx", "fy", "cx", "cy"), build.FOUR, strict=True))
    build.write(tmp_path / "d435.json", camera)
    (source,) = find_frames(tmp_path)
    assert source.name == "7-glass-img"
    assert_allclose(source.read().depth, METRES)


def test_a_file_whose_channels_differ_is_refused_as_a_picture(tmp_path: Path) -> None:
    build.image(tmp_path / "a_color.png", build.color(0))
    write(tmp_path / "a_depth.exr", R=METRES, G=METRES + 1, B=METRES + 2)
    with pytest.raises(FormatError, match="colourised"):
        find_frames(tmp_path)[0].read()


@pytest.mark.parametrize("cut", [0, 4, 100, -30])
def test_damaged_files_are_reported_in_one_sentence_and_not_on_stdout(
    tmp_path: Path, cut: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "d.exr", Z=METRES)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(SymgraspError, match="damaged or cut off" if cut < 0 else r"d\.exr"):
        read_exr(path)
    assert capsys.readouterr().out == ""


def test_the_size_is_bounded_before_pixels_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exr_files, "MAX_PIXELS", METRES.size - 1)
    with pytest.raises(FormatError, match="pixels are read"):
        read_exr(write(tmp_path / "d.exr", Z=METRES))


def test_the_shared_transparent_frame_is_read(shared: Path) -> None:
    (source,) = find_frames(shared / "cases/exr_transparent")
    frame = source.read()
    near, far = np.percentile(frame.depth[frame.depth > 0], (1, 99))
    assert (frame.depth.shape, frame.intrinsics.fx) == ((720, 1280), 921.0)
    assert 0.4 < near < far < 1.3


def test_stdout_is_as_before_after_images_read_by_several_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, path = sys.stdout, write(tmp_path / "depth.exr", Z=METRES)
    monkeypatch.setattr(sys, "stdout", before)
    rng, real = np.random.default_rng(0), OpenEXR.File

    def slow(*args: object, **options: object) -> OpenEXR.File:
        time.sleep(rng.uniform(0.0, 0.003))  # so that the threads overlap
        return real(*args, **options)

    monkeypatch.setattr(OpenEXR, "File", slow)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(read_exr, [path] * 64))
    assert sys.stdout is before
