"""LZF compression: runs, copies that overlap themselves, damage."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.errors import SymgraspError
from pipelines.frames.encodings.pcd_files import decompress
from tests.frames.layouts.build import packed_literally


@given(st.binary(max_size=200))
def test_literal_bytes_come_back(data: bytes) -> None:
    assert decompress(packed_literally(data), len(data)) == data


def test_copies_may_overlap_themselves() -> None:
    # `ab`, then 7 bytes copied from 2 back; then, in the long form, 10 bytes from 1 back.
    packed = bytes([1]) + b"ab" + bytes([5 << 5, 1]) + bytes([7 << 5, 1, 0])
    assert decompress(packed, 19) == b"abababababa"[:9] + b"a" * 10


@pytest.mark.parametrize("packed", [bytes([5 << 5, 9]), bytes([5 << 5]), bytes([3]) + b"ab"])
def test_damage_is_reported_in_one_sentence(packed: bytes) -> None:
    with pytest.raises(SymgraspError):
        decompress(packed, 9)


@given(st.binary(max_size=60))
def test_decompression_of_any_bytes_ends(packed: bytes) -> None:
    try:
        decompress(packed, 50)
    except SymgraspError as error:
        message = str(error)
        assert "cut off" in message or "unpacks to" in message
