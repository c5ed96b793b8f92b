"""Numbers of pixels from headers, and images with too many pixels."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.contents import MAX_PIXELS
from pipelines.errors import FormatError
from pipelines.storage.images import pixels_of, read_image


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp"])
def test_the_header_states_the_number_of_decoded_pixels(suffix: str, kind: type) -> None:
    done, data = cv2.imencode(suffix, np.zeros((40, 51), kind))
    assert done
    assert pixels_of(data.tobytes()) == 40 * 51


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp"])
def test_a_header_that_is_cut_off_has_no_size(suffix: str) -> None:
    data = cv2.imencode(suffix, np.zeros((40, 51), np.uint8))[1].tobytes()
    assert all(pixels_of(data[:size]) is None for size in range(16))
    assert pixels_of(b"GIF89a" + data) is None


@pytest.mark.parametrize("quality", [80, 101])  # above 100, nothing is lost
@pytest.mark.parametrize("channels", [3, 4])
def test_a_webp_states_its_pixels_in_each_of_its_forms(quality: int, channels: int) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (40, 51, channels), dtype=np.uint8)
    data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()
    assert pixels_of(data) == 40 * 51
    assert all(pixels_of(data[:size]) is None for size in range(24))


@pytest.mark.parametrize("comment", [b"", b"# by a camera\n# of 9 9\n"])
def test_netpbm_images_state_their_pixels_and_are_read_as_stored(
    tmp_path: Path, comment: bytes
) -> None:
    grey = np.arange(40 * 51, dtype=np.uint16).reshape(40, 51) * 31
    color = np.random.default_rng(0).integers(0, 255, (40, 51, 3), dtype=np.uint8)
    for suffix, picture in ((".pgm", grey), (".ppm", color)):
        data = cv2.imencode(suffix, picture)[1].tobytes()
        data = data[:3] + comment + data[3:]
        assert pixels_of(data) == 40 * 51
        assert pixels_of(data[:5]) is None
        (tmp_path / "a").write_bytes(data)
        expected = picture if picture.ndim == 2 else picture[:, :, ::-1]
        assert (read_image(tmp_path / "a") == expected).all()
        (tmp_path / "a").write_bytes(data[:-1])
        with pytest.raises(FormatError, match="not a whole image"):
            read_image(tmp_path / "a")


def test_a_png_of_more_pixels_than_any_camera_has_is_refused_before_it_unpacks(
    tmp_path: Path,
) -> None:
    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    head = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 0, 0, 0, 0)
    body = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")
    (tmp_path / "x.png").write_bytes(body)
    with pytest.raises(FormatError, match=f"900000000 pixels; at most {MAX_PIXELS}"):
        read_image(tmp_path / "x.png")


@pytest.mark.parametrize("more", [bytes(512), bytes(9000), b"a video" * 2000])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_bytes_after_the_end_of_a_picture_are_passed_over(
    tmp_path: Path, suffix: str, more: bytes
) -> None:
    data = cv2.imencode(suffix, np.full((40, 51), 7, np.uint8))[1].tobytes()
    (tmp_path / "a").write_bytes(data + more)
    assert (read_image(tmp_path / "a") == 7).all()
    (tmp_path / "a").write_bytes(data[:-12])
    with pytest.raises(FormatError, match="is cut off"):
        read_image(tmp_path / "a")


@pytest.mark.parametrize("progressive", [0, 1])
def test_a_preview_in_a_jpeg_does_not_hide_that_its_end_is_missing(
    tmp_path: Path, progressive: int
) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (40, 51), dtype=np.uint8)
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive]
    data = cv2.imencode(".jpg", picture, options)[1].tobytes()
    preview = b"\xff\xe1" + struct.pack(">H", 2 + len(data)) + data  # a segment of its own
    (tmp_path / "a.jpg").write_bytes(data[:2] + preview + data[2:])
    assert read_image(tmp_path / "a.jpg").shape == (40, 51)
    (tmp_path / "a.jpg").write_bytes(data[:2] + preview + data[2 : len(data) // 2])
    with pytest.raises(FormatError, match="is cut off"):
        read_image(tmp_path / "a.jpg")
