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
