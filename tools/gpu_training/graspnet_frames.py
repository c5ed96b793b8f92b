"""Prepared frames of GraspNet's baseline in one small file for a GPU host: 100 KB per frame.

    python -m tools.gpu_training.graspnet_frames pack OUT.xz NAME.frames
    python -m tools.gpu_training.graspnet_frames unpack OUT.xz NAME.frames

NAME.frames is the folder that `symgrasp train-baseline graspnet ROOT` prepares. The labels of a
point are stored once for all views of a scene, and clouds keep 16,000 points.
"""

import argparse
import io
import lzma
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.contents import reason
from pipelines.errors import FormatError, MissingInputError, counted, errors_as_sentences
from pipelines.learning.peers.peer import (
    Arrays,
    count_peer_frames,
    read_peer_frame,
    write_peer_frames,
)
from pipelines.storage.array_files import DAMAGED
from pipelines.storage.files import existing, write_bytes
from pipelines.storage.provenance import Stamp, digest, make_stamp

WRITTEN_BY = "python -m tools.gpu_training.graspnet_frames pack"
MOST_POINTS = 16_000  # points of a cloud
LABELS = ("cell", "friction", "width", "tolerance")
UNCHANGED = ("points", "object", "turns", "up")  # arrays stored unchanged


def packed_scene(frames: list[Arrays], rng: np.random.Generator) -> Arrays:
    """Return the frames of a scene as one set of arrays; arrays of a frame are NUMBER/NAME."""
    found: dict[bytes, int] = {}  # number of each point's labels by their bytes
    distinct: list[Arrays] = []
    arrays: Arrays = {}
    for number, frame in enumerate(frames):
        ends = np.searchsorted(frame["point"], np.arange(len(frame["points"]) + 1))
        numbers = []
        for start, end in pairwise(ends):
            labels = {name: frame[name][start:end] for name in LABELS}
            key = b"".join(each.tobytes() for each in labels.values())
            if key not in found:
                found[key] = len(distinct)
                distinct.append(labels)
            numbers.append(found[key])
        chosen = np.sort(rng.permutation(len(frame["cloud"]))[:MOST_POINTS])
        own = {name: frame[name] for name in UNCHANGED}
        own["labels"] = np.array(numbers, np.int32)
        own["cloud"] = np.ascontiguousarray(frame["cloud"][chosen].T)
        own["on_object"] = np.packbits(frame["on_object"][chosen])
        arrays |= {f"{number}/{name}": each for name, each in own.items()}
    sizes = [len(each["cell"]) for each in distinct]
    empty: Arrays = {"cell": np.zeros(0, np.int32)}
    empty |= {name: np.zeros(0, np.uint8) for name in LABELS[1:]}
    joined = {n: np.concatenate([empty[n], *(each[n] for each in distinct)]) for n in LABELS}
    joined["cell"] = joined["cell"].astype(np.uint16)
    return arrays | joined | {"sizes": np.array(sizes, np.int32), "count": np.array(len(frames))}


def unpacked_scene(arrays: Arrays) -> list[Arrays]:
    """Return the frames of `packed_scene`."""
    ends = np.cumsum(arrays["sizes"])
    labels = {name: np.split(arrays[name], ends)[:-1] for name in LABELS}
    frames = []
    for number in range(int(arrays["count"])):
        frame = {name: arrays[f"{number}/{name}"] for name in UNCHANGED}
        own = arrays[f"{number}/labels"]
        sizes = arrays["sizes"][own]
        frame["point"] = np.repeat(np.arange(len(own), dtype=np.int32), sizes)
        for name in LABELS:
            parts: list[NDArray[Any]] = [arrays[name][:0], *(labels[name][i] for i in own)]
            frame[name] = np.concatenate(parts)
        frame["cell"] = frame["cell"].astype(np.int32)
        frame["cloud"] = np.ascontiguousarray(arrays[f"{number}/cloud"].T)
        bits = np.unpackbits(arrays[f"{number}/on_object"], count=len(frame["cloud"]))
        frames.append(frame | {"on_object": bits.astype(bool)})
    return frames


def pack_frames(path: Path, folder: Path) -> int:
    """Write the prepared frames of `folder`; return their number.

    Raises:
        MissingInputError: the folder has no prepared frames.
    """
    arrays: Arrays = {}
    rng = np.random.default_rng(0)
    total = 0
    for file in sorted(folder.glob("*.h5")):
        count = count_peer_frames(file)
        frames = [read_peer_frame.__wrapped__(file, row) for row in range(count)]
        scene = packed_scene(frames, rng)
        arrays |= {f"{file.stem}/{name}": each for name, each in scene.items()}
        total += count
    if not total:
        raise MissingInputError(folder / "*.h5", "symgrasp train-baseline graspnet")
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    write_bytes(path, lzma.compress(buffer.getvalue(), preset=6))
    return total


def unpack_frames(path: Path, folder: Path) -> int:
    """Write the frames of `pack_frames` as prepared frames into `folder`; return their number.

    Raises:
        MissingInputError: there is no file `path`.
        FormatError: the file is damaged, or holds something else.
    """
    packed = existing(path, WRITTEN_BY).read_bytes()
    stamp: Stamp = make_stamp(
        "train-baseline", {"method": "graspnet"}, inputs={"packed": digest(path)}
    )
    try:
        file = np.load(io.BytesIO(lzma.decompress(packed)), allow_pickle=False)
    except (*DAMAGED, lzma.LZMAError) as error:
        found = f"holds no packed frames ({reason(error)})"
        raise FormatError(path, found, f"a file of `{WRITTEN_BY}` is expected") from error
    with file:
        names = sorted({name.split("/")[0] for name in file.files})
        keys = {name: [key for key in file.files if key.startswith(f"{name}/")] for name in names}
        total = 0
        for name in names:
            scene = {key.removeprefix(f"{name}/"): file[key] for key in keys[name]}
            frames = unpacked_scene(scene)
            write_peer_frames(folder / f"{name}.h5", frames, stamp)
            total += len(frames)
    return total


if __name__ == "__main__":
    commands = {"pack": pack_frames, "unpack": unpack_frames}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", choices=tuple(commands))
    parser.add_argument("packed", type=Path, help="OUT.xz")
    parser.add_argument("folder", type=Path, help="NAME.frames")
    options = parser.parse_args()
    with errors_as_sentences():
        done = commands[options.command](options.packed, options.folder)
    sys.stdout.write(f"{counted(done, 'frame')}\n")
