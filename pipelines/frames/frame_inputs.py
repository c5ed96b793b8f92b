"""Digests of a frame's files, taken when they are needed: in the worker, before the frame is read.

A dataset has terabytes of images; a pass over every byte before the first frame would take hours.
An existing result records the size and time of change of its files: if these are the same, its
digests are reused without reading the files (D. 127).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pipelines.contents import mapping_in
from pipelines.frames.rgbd import FrameSource
from pipelines.storage.provenance import Stamp, digest, digest_text

Signature = list[int]  # size, time of change in nanoseconds
UNREADABLE = "unreadable"
FRAMES_INPUT = "frames"  # name of the digest of all frames, among the inputs of a `grasps.h5`
MAX_DIGESTS = 2**16  # kept in memory: a bag is one file of many frames, a frame is one of many runs


class FrameInputs(Mapping[str, str]):
    """Digests by name: of inputs that all frames share, and lazily of the frame's own files."""

    def __init__(self, common: Mapping[str, str], files: tuple[Path, ...]) -> None:
        self._common = common
        # Colour and depth may have one name, in two folders.
        self._files = {f"{i} {path.name}": path for i, path in enumerate(files)}
        self._own: dict[str, str] | None = None
        self._signatures: dict[str, Signature] | None = None

    def __getitem__(self, name: str) -> str:
        return self._common[name] if name in self._common else self._digests()[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._common
        yield from self._files

    def __len__(self) -> int:
        return len(self._common) + len(self._files)

    @property
    def are_known(self) -> bool:
        """Whether the digests are known, so that no file is read for them."""
        return self._own is not None

    def signatures(self) -> dict[str, Signature]:
        """Return the size and time of change of the files, just before their digests were made."""
        self._digests()
        return self._signatures or {}

    def take_over(self, stamp: Mapping[str, Any], *, unchecked: bool = False) -> None:
        """Take the digests of the files from the stamp of a result that was made of the files.

        Only if their sizes and times of change agree with the stamp; `unchecked`: in any case,
        for a result of the same run.
        """
        inputs, signatures = stamp.get("inputs"), mapping_in(stamp, "recorded").get("files")
        if not isinstance(inputs, dict) or not self._files.keys() <= inputs.keys():
            return
        now = {name: _signature(path) for name, path in self._files.items()}
        if unchecked or now == signatures:
            self._own = {name: str(inputs[name]) for name in self._files}
            self._signatures = now

    def _digests(self) -> dict[str, str]:
        if self._own is None:
            # Signatures come first: a file that changes meanwhile has another signature later.
            self._signatures = {name: _signature(path) for name, path in self._files.items()}
            self._own = {
                name: _digest(path, *self._signatures[name]) for name, path in self._files.items()
            }
        return self._own


def current_digest(path: Path) -> str:
    """Return the digest of a frame's file; `UNREADABLE` if it cannot be read."""
    return _digest(path, *_signature(path))


def _signature(path: Path) -> Signature:
    try:
        state = path.stat()
    except OSError:  # reading the frame reports why
        return [-1, -1]
    return [state.st_size, state.st_mtime_ns]


def digest_of_stamps(stamps: Iterable[tuple[str, Stamp]]) -> str:
    """Return one digest of frames, each with its name and the stamp of its result, in order.

    The files of stamps with unknown `FrameInputs` are read.
    """
    stamps = list(stamps)
    inputs = [stamp.inputs for _, stamp in stamps]
    unknown = [each for each in inputs if isinstance(each, FrameInputs) and not each.are_known]
    with ThreadPoolExecutor() as threads:  # digests release Python's lock
        list(threads.map(dict, unknown))
    return digest_text("\n".join(f"{name} {stamp.as_digest()}" for name, stamp in stamps))


def is_made_of(
    stamp: Mapping[str, Any], names: Sequence[str], sources: Mapping[str, FrameSource]
) -> bool | None:
    """Return whether `infer` read the present files of `sources`; reads all of these files.

    Args:
        stamp: of the `grasps.h5`, as JSON.
        names: of its frames, in its order.
        sources: frames by name.

    Returns:
        None if that is unknown: the stamp has no digest of the frames, or a frame is missing.
    """
    inputs = dict(mapping_in(stamp, "inputs"))
    wanted = inputs.pop(FRAMES_INPUT, None)
    if wanted is None or not set(names) <= sources.keys():
        return None
    whole = Stamp(str(stamp.get("stage")), mapping_in(stamp, "config"), stamp.get("seed", 0))
    stamps = (
        (name, replace(whole, inputs=FrameInputs(inputs, sources[name].files))) for name in names
    )
    return digest_of_stamps(stamps) == str(wanted)


@lru_cache(maxsize=MAX_DIGESTS)
def _digest(path: Path, _size: int, _changed: int) -> str:
    try:
        return digest(path)
    except OSError:  # reading the frame reports why
        return UNREADABLE
