"""The complete frames of a folder while a camera still writes into it.

A frame is complete when its files have not changed for a while by the local clock: the clock of a
camera or a file server may differ. If a frame cannot be read then, its second image may be late, so
it is read once more after a longer time before it counts as failed. A frame whose files change
again is a new frame.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipelines.configs import WatchConfig
from pipelines.frames.rgbd import FrameSource

State = tuple[tuple[str, int, int, int], ...]  # path, size, time of change, file number


@dataclass(frozen=True)
class Clock:
    """The functions for the current time and for waiting."""

    now: Callable[[], float] = time.monotonic
    wait: Callable[[float], None] = time.sleep


class Lister:
    """Lists the frames of a folder again if a folder with frames has changed, or after a while.

    Each listing reads all names: about 0.1 ms of a core for each frame in the folder, so 1 s for
    10,000, and several times longer while all cores are busy. Checking the folders for changes
    takes no time. Changes in no known folder (an index file that grew, the first frame of a new
    folder) are found after `relist` seconds.
    """

    def __init__(
        self, find: Callable[[], Sequence[FrameSource]], folder: Path, config: WatchConfig
    ) -> None:
        self._find, self._folder, self._config = find, folder, config
        self._sources: Sequence[FrameSource] = ()
        self._folders = {folder}
        self._changes: dict[Path, int] | None = None
        self._listed = 0.0

    def frames(self, now: float) -> Sequence[FrameSource]:
        """Return the frames in the folder at the time `now`.

        Raises:
            SymgraspError: the folder is missing.
        """
        # Read before the listing, so that the next call sees changes during the listing.
        changes = {path: _changed_at(path) for path in self._folders}
        if changes == self._changes and now - self._listed < self._config.relist:
            return self._sources
        self._sources = self._find()
        self._changes, self._listed = changes, now
        parents = {path.parent for source in self._sources for path in source.files}
        ups = {up for parent in parents for up in (parent, *parent.parents)}
        self._folders = {self._folder} | {up for up in ups if up.is_relative_to(self._folder)}
        return self._sources


def _changed_at(folder: Path) -> int:
    try:
        return folder.stat().st_mtime_ns
    except OSError:  # the folder is gone; the listing will show this
        return 0


@dataclass
class _FrameState:
    """The last seen state of a frame."""

    state: State
    since: float  # seconds, time when this state was first seen
    put_off: bool = False
    finished: bool = False


@dataclass(frozen=True)
class Arrival:
    """A complete frame, the time of its last change, and whether a failure is final."""

    source: FrameSource
    since: float
    is_last_try: bool


class Watcher:
    """Keeps the states of the frames of a folder, and returns the frames to read now."""

    def __init__(self, config: WatchConfig) -> None:
        self._config = config
        self._frames: dict[str, _FrameState] = {}

    def arrivals(self, sources: Sequence[FrameSource], now: float) -> list[Arrival]:
        """Return the frames to read at the time `now`, the longest unchanged first.

        A frame is returned until it is finished or put off.
        """
        frames = {}
        for source in sources:
            state = state_of(source)
            if state is None:
                continue
            before = self._frames.get(source.name)
            unchanged = before if before and before.state == state else None
            frames[source.name] = unchanged or _FrameState(state, now)
        self._frames = frames
        arrivals = [
            Arrival(source, frames[source.name].since, frames[source.name].put_off)
            for source in sources
            if source.name in frames and self._is_due(frames[source.name], now)
        ]
        return sorted(arrivals, key=lambda arrival: arrival.since)

    def finish(self, name: str) -> None:
        """Note that a frame is finished until its files change."""
        if name in self._frames:  # the frame may be gone
            self._frames[name].finished = True

    def put_off(self, name: str) -> None:
        """Note that a frame could not be read yet."""
        if name in self._frames:
            self._frames[name].put_off = True

    def is_waiting(self) -> bool:
        """Return whether there are frames that may be incomplete."""
        return any(not frame.finished and not frame.put_off for frame in self._frames.values())

    def last_change(self) -> float | None:
        """Return the time of the last change of any frame; None without frames."""
        return max((frame.since for frame in self._frames.values()), default=None)

    def _is_due(self, frame: _FrameState, now: float) -> bool:
        wait = self._config.patience if frame.put_off else self._config.settle
        return not frame.finished and now - frame.since >= wait


def state_of(source: FrameSource) -> State | None:
    """Return the state of a frame's files; None if a file has just gone."""
    try:
        files = [(str(path), path.stat()) for path in source.files]
    except OSError:  # a file has gone since the listing
        return None
    return tuple((name, each.st_size, each.st_mtime_ns, each.st_ino) for name, each in files)
