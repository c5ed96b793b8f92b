"""Typed mutations of input files: right in form, wrong in content, and the reverse."""

import contextlib
import copy
import json
import os
import random
import re
import sqlite3
import struct
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.attacks import archives, hdf5_mutations

DEEP = 3000  # levels, above Python's limit of recursion
ODD_TEXTS = (
    "",
    "x",
    "\x1b[31mred\x1b[0m",
    "a\nerror: b",
    "=1+1",
    "../../etc/passwd",
    "\ud800",
    "9" * 400,
)
ODD_VALUES: tuple[Any, ...] = (
    *(None, True, [], {}, [[]], [None], {"": None}, 0, -1, 1, 2**31, 2**63, 10**9, 10**40),
    *(1e30, 1e-30, 1e308, float("nan"), float("inf"), -float("inf"), *ODD_TEXTS),
)  # fmt: skip

ODD_WORDS = (
    *("", "-1", "0", "nan", "inf", "1e999", "9" * 40, "4000000000", "x", "[[[[", "&a [*a]"),
    *("\x1b[31m", "!!python/object:os.system", "- " * 50, "[" * DEEP, "1 2 3 4 5 6 7"),
)
# As numbers of four bytes: the largest, -1, nan, infinity, 0, a thousand million, 1e37.
ODD_BYTES = (
    *(b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\0\0\xc0\x7f", b"\0\0\x80\x7f"),
    *(b"\0\0\0\0", b"\0\xca\x9a\x3b", b"\x20\xbc\xbe\x7e"),
)

Mutation = Callable[[bytes, random.Random], bytes]


def mutate(path: Path, rng: random.Random) -> str:
    """Put a mutation in the place of the file `path`; return the change in words."""
    kinds = [*BY_SUFFIX.get(path.suffix.lower(), (odd_token,)), damaged]
    kind = rng.choices(kinds, [3] * (len(kinds) - 1) + [1])[0]
    data = path.read_bytes()
    path.unlink()  # the file may be one of several names of one file
    if kind is hdf5_mutations.mutated:
        return f"hdf5 {hdf5_mutations.mutated(data, path, rng)}"
    try:
        path.write_bytes(kind(data, rng))
    except (
        ValueError,
        LookupError,
        OverflowError,
        sqlite3.Error,
    ) as error:  # the kind does not suit the file
        path.write_bytes(damaged(data, rng))
        return f"damaged ({type(error).__name__})"
    return kind.__name__


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return `data` cut off, with other bits, or with a piece that is doubled or lost."""
    if not data:
        return b"\0"
    at = rng.randrange(len(data))
    changed = bytearray(data)
    for _ in range(rng.randrange(1, 8)):
        changed[rng.randrange(len(changed))] = rng.choice((0, 1, 127, 128, 255))
    ways = (
        data[:at],
        b"",
        data[:at] + data[at : at + 64] * 3 + data[at + 64 :],
        data[:at] + data[at + rng.randrange(1, 64) :],
        bytes(rng.randrange(256) for _ in range(min(len(data), 512))),
        bytes(changed),
        bytes(changed),
    )
    return rng.choice(ways)


def odd_value(content: Any, rng: random.Random) -> Any:
    """Return `content` with one value, somewhere inside, of another type, size or shape."""
    content = copy.deepcopy(content)
    places = list(_places(content))
    if not places:
        return rng.choice(ODD_VALUES)
    owner, key = rng.choice(places)
    match rng.randrange(5):
        case 0 if isinstance(owner, dict):
            owner[rng.choice(ODD_TEXTS)] = owner.pop(key)
        case 1:
            del owner[key]
        case 2:
            owner[key] = [owner[key]] if rng.random() < 0.5 else {"x": owner[key]}
        case 3 if isinstance(owner[key], list):
            owner[key] = owner[key] * 2 if rng.random() < 0.5 else owner[key][:-1]
        case _:
            owner[key] = rng.choice(ODD_VALUES)
    return content


def _places(content: Any) -> Any:
    """Yield (container, key) of some values of every container."""
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for place, (key, value) in enumerate(items):
        if place < 30:
            yield content, key
            if isinstance(value, dict | list):
                yield from _places(value)


def json_value(data: bytes, rng: random.Random) -> bytes:
    """Return JSON with an odd value somewhere."""
    return json.dumps(odd_value(json.loads(data), rng)).encode()


def json_form(data: bytes, rng: random.Random) -> bytes:
    """Return JSON that is deep, of another kind, or not quite JSON."""
    text = data.decode()
    deep = "[" * DEEP + "]" * DEEP
    inner = '{"a":' * 500 + "1" + "}" * 500
    ways = (
        deep,
        re.sub(r": (?=[\[{\"\d])", f': {deep}, "old": ', text, count=1),
        json.dumps(rng.choice(ODD_VALUES)),
        json.dumps([json.loads(data)]),
        f"\ufeff{text}",
        re.sub(r"\d+(\.\d+)?", "1e999", text, count=rng.randrange(1, 4)),
        re.sub(r"\d+", "9" * 5000, text, count=1),
        f'{text[:-2]}, "x": {inner}}}',
    )
    return rng.choice(ways).encode()


def toml_value(data: bytes, rng: random.Random) -> bytes:
    """Return TOML with an odd value, a table in the place of a value, or deep nesting."""
    lines = data.decode().splitlines()
    settings = [i for i, line in enumerate(lines) if "=" in line and not line.startswith("#")]
    at = rng.choice(settings)
    name = lines[at].split("=")[0].strip()
    odd = (
        *("true", "[]", "{}", "-1", "0", "1e308", "nan", "inf", "-inf", '""', '"\\u001b[31m"'),
        *('"a\\nb"', "9" * 30, "[[]]", "1979-05-27", "{x = 1}", "0x7fffffffffffffff"),
        f'"{"x" * 9999}"',
    )
    match rng.randrange(8):
        case 0:
            lines[at] = f"{name} = {'[' * DEEP}{']' * DEEP}"
        case 1:
            lines[at] = ".".join([name] * DEEP) + " = 1"
        case 2:
            lines[at] = (
                f"{rng.choice(('x', name + '.x', chr(34) + chr(92) + 'u001b[31m' + chr(34)))} = 1"
            )
        case 3:
            lines[at] = ""
        case 4:
            lines = [f"[{'.'.join(['a'] * DEEP)}]", *lines]
        case _:
            lines[at] = f"{name} = {rng.choice(odd)}"
    return "\n".join(lines).encode()


def odd_token(data: bytes, rng: random.Random) -> bytes:
    """Return text (YAML, XML, OBJ, OFF, a list of numbers) with some of its words replaced."""
    text = data.decode("latin1")
    words = list(re.finditer(r"[-+.\w]+", text))
    for found in sorted(
        rng.sample(words, min(len(words), rng.randrange(1, 3))), key=lambda w: -w.start()
    ):
        odd = rng.choice(ODD_WORDS)
        text = text[: found.start()] + odd + text[found.end() :]
    return text.encode("latin1")


def png_size(data: bytes, rng: random.Random) -> bytes:
    """Return a PNG with wrong sizes or bits in its header, or a bomb; check sums are right."""
    width, height, bits, kind = struct.unpack_from(">IIBB", data, 16)
    match rng.randrange(6):
        case 0:
            side = rng.choice((30_000, 16_000, 65_000))
            rows = zlib.compressobj(9)
            line = b"\0" * (side * (1 if kind == 0 and bits == 8 else 2) + 1)
            body = b"".join(rows.compress(line) for _ in range(side // 50)) + rows.flush()
            return _png(side, side, 16 if bits == 16 else 8, 0, body)
        case 1:
            return _png(
                rng.choice((0, 1, 2**31 - 1, 2**20, width * 2)), height, bits, kind, _pixels(data)
            )
        case 2:
            return _png(
                width, rng.choice((0, 1, 2**31 - 1, 2**20, height // 2)), bits, kind, _pixels(data)
            )
        case 3:
            return _png(
                width,
                height,
                rng.choice((1, 2, 4, 8, 16, 3)),
                rng.choice((0, 2, 3, 4, 6)),
                _pixels(data),
            )
        case 4:
            text = _chunk(b"zTXt", b"a\0\0" + zlib.compress(b"x" * 50_000_000))
            return data[:33] + text + data[33:]
        case _:
            value = rng.choice((0, 1, 255))
            channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[kind]
            line = b"\0" + bytes([value]) * (width * channels * bits // 8)
            return _png(width, height, bits, kind, zlib.compress(line * height))


def _png(width: int, height: int, bits: int, kind: int, body: bytes) -> bytes:
    head = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    palette = _chunk(b"PLTE", bytes(range(256)) * 3) if kind == 3 else b""
    return (
        b"\x89PNG\r\n\x1a\n"
        + _chunk(b"IHDR", head)
        + palette
        + _chunk(b"IDAT", body)
        + _chunk(b"IEND", b"")
    )


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def _pixels(data: bytes) -> bytes:
    at, found = 8, b""
    while at + 8 <= len(data):
        size = struct.unpack_from(">I", data, at)[0]
        found += data[at + 8 : at + 8 + size] if data[at + 4 : at + 8] == b"IDAT" else b""
        at += 12 + size
    return found


def header_count(data: bytes, rng: random.Random) -> bytes:
    """Return a mesh or cloud that announces other counts, or holds odd numbers and indices."""
    if data.startswith(b"ply") or b"FIELDS" in data[:400]:
        head, mark, body = data.partition(b"end_header\n" if data.startswith(b"ply") else b"DATA")
        numbers = list(re.finditer(rb"(?<=[ ])\d+", head))
        found = rng.choice(numbers)
        odd = rng.choice((b"0", b"-1", b"1000000000", b"4000000000000", b"7", b"x"))
        return head[: found.start()] + odd + head[found.end() :] + mark + body
    return _odd_words(data, rng)


def odd_numbers(data: bytes, rng: random.Random) -> bytes:
    """Return a binary file with some words of four bytes that are odd as numbers."""
    return _odd_words(data, rng)


def _odd_words(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randrange(1, 5)):
        word = rng.choice(ODD_BYTES)
        at = 4 * rng.randrange(max(1, len(changed) // 4))
        changed[at : at + 4] = word
    return bytes(changed[: len(data)])


def glb_value(data: bytes, rng: random.Random) -> bytes:
    """Return a GLB whose JSON has an odd value, or nodes that show one mesh many times."""
    size = struct.unpack_from("<I", data, 12)[0]
    content = json.loads(data[20 : 20 + size])
    if rng.random() < 0.2:
        content["nodes"] = [content["nodes"][-1] | {"name": str(i)} for i in range(20_000)]
        content["scenes"] = [{"nodes": list(range(20_000))}]
    else:
        content = odd_value(content, rng)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    return (
        data[:8]
        + struct.pack("<III", 20 + len(text) + len(rest), len(text), 0x4E4F534A)
        + text
        + rest
    )


def safetensors_head(data: bytes, rng: random.Random) -> bytes:
    """Return safetensors with an odd value in the header, or in JSON within its metadata."""
    size = struct.unpack_from("<Q", data)[0]
    head = json.loads(data[8 : 8 + size])
    inner = [key for key, text in head.get("__metadata__", {}).items() if text.startswith("{")]
    if inner and rng.random() < 0.6:
        key, kind = rng.choice(inner), rng.choice((json_value, json_form))
        head["__metadata__"][key] = kind(head["__metadata__"][key].encode(), rng).decode(
            "utf-8", "replace"
        )
    else:
        head = odd_value(head, rng)
    text = json.dumps(head).encode()
    return struct.pack("<Q", len(text)) + text + data[8 + size :]


def database_cell(data: bytes, rng: random.Random) -> bytes:
    """Return an SQLite file with one cell of a table changed, or a table without a column."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.db3"
        path.write_bytes(data)
        with contextlib.closing(sqlite3.connect(path)) as base:
            tables = [name for (name,) in base.execute("SELECT name FROM sqlite_master")]
            table = rng.choice([name for name in tables if not name.startswith("sqlite")])
            columns = [row[1] for row in base.execute(f"PRAGMA table_info('{table}')")]
            if not columns:
                raise LookupError
            column = rng.choice(columns)
            if rng.random() < 0.1:
                base.execute(f"ALTER TABLE '{table}' RENAME COLUMN '{column}' TO 'x'")
            else:
                odd = (None, -1, 0, 2**62, 1e300, "", "x", "\x1b[31m", b"", b"\xff" * 40)
                found = base.execute(f"SELECT rowid, {column} FROM '{table}'").fetchall()
                row, value = rng.choice(found)
                if isinstance(value, bytes) and rng.random() < 0.7:
                    changed = rng.choice((damaged, odd_numbers))(value, rng)
                else:
                    changed = rng.choice(odd)
                base.execute(f"UPDATE '{table}' SET {column} = ? WHERE rowid = ?", (changed, row))
            base.commit()
        return path.read_bytes()


LINKS = ("a pipe", "a folder", "a link to itself", "a device", "a link to nothing", "nothing")


def with_link(path: Path, kind: str) -> str:
    """Put a link, pipe, folder or device (`LINKS`) in the place of `path`; return `kind`."""
    path.unlink()
    match kind:
        case "a pipe":
            os.mkfifo(path)
        case "a folder":
            path.mkdir()
        case "a link to itself":
            path.symlink_to(path.name)
        case "a device":
            path.symlink_to("/dev/zero")
        case "a link to nothing":
            path.symlink_to("nothing")
    return kind


BY_SUFFIX: dict[str, tuple[Mutation, ...]] = {
    ".json": (json_value, json_value, json_form),
    ".toml": (toml_value,),
    ".png": (png_size, damaged),
    ".h5": (hdf5_mutations.mutated,),  # type: ignore[dict-item]
    ".npz": (archives.npz_member, archives.npz_member),
    ".npy": (archives.npy_array,),
    ".ply": (header_count, odd_numbers),
    ".pcd": (header_count, odd_numbers, odd_token),
    ".stl": (odd_numbers,),
    ".glb": (glb_value, glb_value, odd_numbers),
    ".mat": (odd_numbers,),
    ".db3": (database_cell, database_cell, odd_numbers),
    ".bag": (odd_numbers, odd_token),
    ".mcap": (odd_numbers, odd_token),
    ".exr": (odd_numbers, odd_numbers),
    ".safetensors": (safetensors_head, safetensors_head),
}
