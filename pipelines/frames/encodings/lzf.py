"""LZF, the compression inside `binary_compressed` point clouds."""

from pipelines.errors import SymgraspError

LITERAL_RUNS = 32  # a smaller control byte announces that many bytes and one, as they are
LONG_COPY = 7  # this length is continued in the next byte


def decompress(packed: bytes, size: int) -> bytes:
    """Return the `size` bytes that `packed` holds.

    Raises:
        SymgraspError: it holds another number of bytes, or refers to bytes that are not there.
    """
    out = bytearray()
    at = 0
    try:
        while at < len(packed) and len(out) <= size:
            control = packed[at]
            at += 1
            if control < LITERAL_RUNS:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == LONG_COPY:
                length += packed[at]
                at += 1
            back = ((control & 31) << 8) + packed[at] + 1
            at += 1
            _copy(out, back, length + 2)
    except IndexError as error:
        raise SymgraspError("the compressed points are cut off") from error
    if len(out) != size:
        raise SymgraspError(f"unpacks to {len(out)} bytes instead of {size}")
    return bytes(out)


def _copy(out: bytearray, back: int, length: int) -> None:
    """Append `length` bytes that lie `back` bytes before the end; they may overlap the new."""
    if back > len(out):
        raise IndexError(back)
    piece = out[len(out) - back : len(out) - back + length]
    while len(piece) < length:
        piece += piece[: length - len(piece)]
    out += piece
