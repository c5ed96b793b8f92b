"""Bags of compressed images, single files of ROS 2, and lenses in CameraInfo."""

import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import FormatError
from pipelines.frames.cameras.lens import BROWN, NO_DISTORTION, Distortion
from pipelines.frames.frames import find_frames
from pipelines.storage.images import encode_image
from tests.frames.layouts import build
from tests.frames.layouts.test_rosbag import TOPICS, write_bag

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
A, B = 40.0, -2.0
DEPTH_TOPIC = TOPICS["depth"] + "/compressedDepth"


def png(image: np.ndarray) -> bytes:
    return encode_image(image, ".png")


def jpeg(image: np.ndarray) -> bytes:
    return encode_image((image >> 4).astype(np.uint8) if image.dtype == "u2" else image, ".jpg")


def compressed_depth(depth: np.ndarray) -> bytes:
    return bytes(12) + png(depth)


def inverse_depth(metres: np.ndarray) -> bytes:
    values = np.where(np.isnan(metres), 0, np.round(A / metres + B)).astype(np.uint16)
    return struct.pack("<iff", 0, A, B) + png(values)


PNG_COLOR = {"color": ("rgb8; png compressed bgr8", png)}


@pytest.mark.parametrize(
    ("ros", "depth"),
    [
        (1, ("16UC1; compressedDepth", compressed_depth)),
        (2, ("16UC1; compressedDepth png", compressed_depth)),
        (2, ("16UC1; png compressed ", png)),
        (2, ("png", png)),
    ],
)
def test_png_gives_the_pixels_of_raw_images(tmp_path: Path, ros: int, depth: tuple) -> None:
    suffix = "/compressedDepth" if "Depth" in depth[0] else "/compressed"
    topics = TOPICS | {
        "color": TOPICS["color"] + "/compressed",
        "depth": TOPICS["depth"] + suffix,
    }
    path = tmp_path / ("a.bag" if ros == 1 else "a")
    write_bag(path, ros=ros, topics=topics, packed=PNG_COLOR | {"depth": depth})
    for i, source in enumerate(find_frames(tmp_path)):
        frame = source.read()
        assert_array_equal(frame.color, build.color(i))
        assert_allclose(frame.depth, build.depth(i) / np.float32(1000))
        assert frame.intrinsics.matrix.tolist() == build.K.tolist()
        assert frame.notes == ()


def test_jpeg_colour_is_read(tmp_path: Path) -> None:
    topics = TOPICS | {"color": TOPICS["color"] + "/compressed"}
    write_bag(tmp_path / "a", topics=topics, packed={"color": ("jpeg", jpeg)})
    frame = find_frames(tmp_path)[0].read()
    assert abs(frame.color.mean() - build.color(0).mean()) < 5.0


def test_colour_of_sixteen_bits_is_refused(tmp_path: Path) -> None:
    topics = TOPICS | {"color": TOPICS["color"] + "/compressed"}
    how = {"color": ("rgb16; png compressed ", lambda image: png(image.astype(np.uint16) * 257))}
    write_bag(tmp_path / "a", topics=topics, packed=how)
    with pytest.raises(FormatError, match="colour image of uint16; 8 bit is expected"):
        find_frames(tmp_path)[0].read()


def test_compressed_depth_of_floats_is_inverse(tmp_path: Path) -> None:
    how = {"depth": ("32FC1; compressedDepth png", inverse_depth)}
    write_bag(tmp_path / "a", depth="32FC1", topics=TOPICS | {"depth": DEPTH_TOPIC}, packed=how)
    frame = find_frames(tmp_path)[0].read()
    metres = build.depth(0) / 1000
    assert ((frame.depth == 0) == (metres == 0)).all()
    seen = metres > 0
    assert np.abs(A / frame.depth[seen] - A / metres[seen]).max() <= 0.51


@pytest.mark.parametrize("how", ["jpeg", "16UC1; jpeg compressed ", "mono8; jpeg compressed "])
def test_depth_of_eight_bits_is_refused_with_its_format(tmp_path: Path, how: str) -> None:
    topics = TOPICS | {"depth": TOPICS["depth"] + "/compressed"}
    write_bag(tmp_path / "a", topics=topics, packed={"depth": (how, jpeg)})
    with pytest.raises(FormatError, match=r"aligned_depth_to_color.*8 bits.*compressedDepth"):
        find_frames(tmp_path)[0].read()


def test_depth_of_an_unknown_compression_is_refused_with_its_format(tmp_path: Path) -> None:
    how = {"depth": ("16UC1; compressedDepth rvl", compressed_depth)}
    write_bag(tmp_path / "a", topics=TOPICS | {"depth": DEPTH_TOPIC}, packed=how)
    with pytest.raises(FormatError, match="rvl"):
        find_frames(tmp_path)[0].read()


@pytest.mark.parametrize("suffix", ["mcap", "db3"])
def test_a_single_file_of_a_bag_is_read(tmp_path: Path, suffix: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    plugin = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}[suffix]
    monkey = pytest.MonkeyPatch()
    monkey.setitem(Writer.__init__.__kwdefaults__, "storage_plugin", plugin)
    write_bag(tmp_path / "whole")
    monkey.undo()
    (tmp_path / "alone").mkdir()
    file = shutil.copy(tmp_path / f"whole/whole.{suffix}", tmp_path / f"alone/take.{suffix}")
    frames = [source.read() for source in find_frames(tmp_path / "alone")]
    assert [frame.name.partition("/")[0] for frame in frames] == ["take"] * build.COUNT
    assert_array_equal(frames[1].color, build.color(1))
    assert len(find_frames(Path(file))) == build.COUNT


def test_a_database_of_another_program_is_refused_as_bag(tmp_path: Path) -> None:
    build.flat(tmp_path / "below")
    (tmp_path / "thumbs.db3").write_bytes(b"anything")
    assert {source.layout for source in find_frames(tmp_path)} == {"flat pairs"}


LENS = (-0.3, 0.1, 0.0, 0.0, 0.0)


def test_the_lens_of_a_camera_info_is_removed(tmp_path: Path) -> None:
    write_bag(tmp_path / "a", lens=LENS)
    frame = find_frames(tmp_path)[0].read()
    assert frame.removed == Distortion(BROWN, LENS[:2])
    assert frame.intrinsics.fx == build.FOUR[0]


def test_rectified_images_take_the_projection_matrix_and_no_lens(tmp_path: Path) -> None:
    topics = TOPICS | {
        "depth": "/camera/depth_registered/image_rect",
        "info": "/camera/depth_registered/camera_info",
    }
    write_bag(tmp_path / "a", topics=topics, lens=LENS)
    frame = find_frames(tmp_path)[0].read()
    assert frame.removed is None or frame.removed == NO_DISTORTION
    assert frame.intrinsics.fx == build.FOUR[0] + 5.0


@pytest.mark.parametrize(
    ("case", "count"),
    [("jpg_cdepth", 3), ("jpg_pngdepth", 1), ("jpg_rawdepth", 1), ("raw_cdepth", 1)],
)
def test_the_shared_bags_are_read(case: str, count: int, shared: Path) -> None:
    frames = [source.read() for source in find_frames(shared / "cases/bag_compressed" / case)]
    assert [frame.depth.shape for frame in frames] == [(360, 640)] * count
    near, far = np.percentile(frames[0].depth[frames[0].depth > 0], (1, 99))
    assert (round(float(near), 3), round(float(far), 3)) == (0.267, 0.585)


def test_a_time_that_is_a_text_is_reported_in_one_sentence(tmp_path: Path) -> None:
    write_bag(tmp_path / "a")
    (base,) = (tmp_path / "a").glob("*.db3")
    with closing(sqlite3.connect(base)) as opened:
        opened.execute("UPDATE messages SET timestamp = 'x'")
        opened.commit()
    with pytest.raises(FormatError, match="time"):
        [source.read() for source in find_frames(tmp_path)]
