"""Point clouds of the Point Cloud Library, `.pcd`: text, binary and compressed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.contents import MAX_PIXELS
from pipelines.errors import FormatError, SymgraspError
from pipelines.storage.files import read_bytes

HEADER_BYTES = 4096
KINDS = {"F": "f", "I": "i", "U": "u"}
FORMS = ("ascii", "binary", "binary_compressed")
MOST_VALUES = 1024  # of a field; histograms have some hundreds
MAX_BYTES = 2**30  # of a cloud: MAX_PIXELS of sixty-four bytes
LITERAL_RUNS = 32  # of LZF: a smaller control byte n announces n + 1 literal bytes
LONG_COPY = 7  # this length is continued in the next byte
COPY_AGAIN = "copy the whole file again"


@dataclass(frozen=True)
class Header:
    """Content of the text at the head of a `.pcd` file."""

    fields: tuple[tuple[str, np.dtype[Any], int], ...]  # name, type, number of values
    width: int
    height: int
    form: str  # one of FORMS
    start: int  # byte at which the points begin

    @property
    def count(self) -> int:
        """The number of points."""
        return self.width * self.height

    @property
    def point_bytes(self) -> int:
        """The bytes of a point, in the forms other than text."""
        return sum(count * kind.itemsize for _name, kind, count in self.fields)


def read_pcd(path: Path) -> dict[str, NDArray[Any]]:
    """Read the fields with one value per point, each (height, width), as stored.

    Raises:
        FormatError: damaged, cut off, or none of the three forms.
    """
    content = read_bytes(path, MAX_BYTES)
    header = _header(path, content)
    body = content[header.start :]
    match header.form:
        case "ascii":
            columns = _text_columns(path, header, body)
        case "binary":
            columns = _columns(path, header, body)
        case _:
            columns = _columns_in_turn(path, header, _unpacked(path, header, body))
    shape = (header.height, header.width)
    single = [name for name, _kind, count in header.fields if count == 1 and name != "_"]
    return {name: columns[name].reshape(shape) for name in single}


def _header(path: Path, content: bytes) -> Header:
    facts: dict[str, list[str]] = {}
    start = 0
    for line in content[:HEADER_BYTES].splitlines(keepends=True):
        start += len(line)
        key, *values = line.decode("ascii", errors="replace").split() or [""]
        facts[key] = values
        if key == "DATA":
            break
    try:
        width, height = (int(facts[key][0]) for key in ("WIDTH", "HEIGHT"))
        names, form = facts["FIELDS"], facts["DATA"][0]
        counts = [int(count) for count in facts.get("COUNT", ["1"] * len(names))]
        kinds = [
            np.dtype(KINDS[kind] + str(int(size)))
            for kind, size in zip(facts["TYPE"], facts["SIZE"], strict=True)
        ]
        fields = tuple(zip(names, kinds, counts, strict=True))
    except (LookupError, ValueError, TypeError) as error:
        raise FormatError(path, f"has a faulty head ({error})", "a .pcd is expected") from error
    if form not in FORMS or not all(0 < count <= MOST_VALUES for count in counts):
        raise FormatError(path, f"has COUNT {counts}, DATA {form}", f"DATA is {', '.join(FORMS)}")
    if min(width, height) < 1 or width * height > MAX_PIXELS:
        found = f"is a cloud of {width}x{height} points"
        raise FormatError(path, found, f"1 to {MAX_PIXELS} points are expected")
    header = Header(fields, width, height, form, start)
    if header.count * header.point_bytes > MAX_BYTES:
        found = f"announces {header.count * header.point_bytes} bytes"
        raise FormatError(path, found, f"at most {MAX_BYTES} are read")
    return header


def _text_columns(path: Path, header: Header, body: bytes) -> dict[str, NDArray[Any]]:
    lines = [line for line in body.decode("latin1").splitlines() if line.strip()]
    if len(lines) != header.count:
        raise FormatError(
            path, f"has {len(lines)} points, {header.count} are announced", COPY_AGAIN
        )
    try:
        rows = np.loadtxt(lines, dtype=np.float64, ndmin=2, comments=None)
    except (ValueError, TypeError) as error:
        raise FormatError(path, f"has a line that is no point ({error})", COPY_AGAIN) from error
    ends = np.cumsum([count for _name, _kind, count in header.fields])
    if rows.shape != (header.count, ends[-1]):
        found = f"has {rows.shape[0]} points of {rows.shape[1]} values"
        raise FormatError(path, found, f"{header.count} of {ends[-1]} are announced")
    columns = {}
    for (name, kind, _count), end in zip(header.fields, ends, strict=True):
        with np.errstate(all="ignore"):  # values that do not fit are damage, found later
            columns[name] = rows[:, end - 1].astype(kind)
    return columns


def _columns(path: Path, header: Header, body: bytes) -> dict[str, NDArray[Any]]:
    names = [name if name != "_" else f"_{i}" for i, (name, *_) in enumerate(header.fields)]
    try:
        point = np.dtype(
            [(name, *rest) for name, (_, *rest) in zip(names, header.fields, strict=True)]
        )
        points = np.frombuffer(body, point, header.count)
    except ValueError as error:  # a name twice, or too few bytes
        raise FormatError(path, f"does not hold its points ({error})", COPY_AGAIN) from error
    return {name: points[name] for name in names}


def _columns_in_turn(path: Path, header: Header, body: bytes) -> dict[str, NDArray[Any]]:
    """Return the columns of compressed points: each field of all points, one after the other."""
    needed = header.count * header.point_bytes
    if len(body) < needed:
        raise FormatError(path, f"holds {len(body)} bytes of points, not {needed}", COPY_AGAIN)
    columns, at = {}, 0
    for name, kind, count in header.fields:
        columns[name] = np.frombuffer(body, kind, header.count * count, at)
        at += header.count * count * kind.itemsize
    return columns


def _unpacked(path: Path, header: Header, body: bytes) -> bytes:
    if len(body) < 8:
        raise FormatError(path, "this cloud is cut off", COPY_AGAIN)
    packed, unpacked = (int(size) for size in np.frombuffer(body, "<u4", 2))
    if unpacked != header.count * header.point_bytes:
        found = f"unpacks to {unpacked} bytes, not {header.count * header.point_bytes}"
        raise FormatError(path, found, COPY_AGAIN)
    try:
        return decompress(body[8 : 8 + packed], unpacked)
    except SymgraspError as error:
        raise FormatError(path, str(error), COPY_AGAIN) from error


def decompress(packed: bytes, size: int) -> bytes:
    """Return the `size` bytes that `packed` holds in LZF, the compression of these clouds.

    Raises:
        SymgraspError: `packed` holds another number of bytes, or refers to missing bytes.
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
    """Append `length` bytes from `back` bytes before the end; they may overlap the new bytes."""
    if back > len(out):
        raise IndexError(back)
    piece = out[len(out) - back : len(out) - back + length]
    while len(piece) < length:
        piece += piece[: length - len(piece)]
    out += piece
