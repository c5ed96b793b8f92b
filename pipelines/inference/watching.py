"""The frames of a folder that are whole while a camera still writes into it.

A frame is whole when none of its files has changed for a while, as seen from here: the clock of a
camera or a file server may be another. What cannot be read then may be a pair whose second image is
late, so it is read once more after a longer while before it has failed. A frame whose files change
again is a new one.
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
    """Where the time comes from, and how it passes."""

    now: Callable[[], float] = time.monotonic
    wait: Callable[[float], None] = time.sleep


class Lister:
    """Lists the frames of a folder anew where a folder of theirs has changed, or after a while.

    To list thousands takes 0.3 s; to see that no file came or went, no time. What
    shows in no known folder (an index file that grew, the first frame of a new folder) is seen
    after the while.
    """

    def __init__(
        self, find: Callable[[], Sequence[FrameSource]], folder: Path, config: WatchConfig
    ) -> None:
        self._find, self._folder, self._config = find, folder, config
        self._sources: Sequence[FrameSource] = ()
        self._folders = {folder}
        self._changes: dict[Path, int] | None = None
        self._listed = 0.0

    def look(self, now: float) -> Sequence[FrameSource]:
        """Return the frames that are there at the time `now`.

        Raises:
            SymgraspError: the folder is not there.
        """
        # Read before the listing: the next look sees what changes meanwhile.
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
    except OSError:  # it has gone; the listing will show it
        return 0


@dataclass
class _Seen:
    """A frame as it was seen last."""

    state: State
    since: float  # seconds, when it was first seen so
    put_off: bool = False
    finished: bool = False


@dataclass(frozen=True)
class Arrival:
    """A frame that is whole: since when it is as it is, and whether a failure is final."""

    source: FrameSource
    since: float
    is_last_try: bool


class Watcher:
    """Remembers the frames of a folder, and says which are to be read now."""

    def __init__(self, config: WatchConfig) -> None:
        self._config = config
        self._seen: dict[str, _Seen] = {}

    def look(self, sources: Sequence[FrameSource], now: float) -> list[Arrival]:
        """Return the frames to read at the time `now`, the longest unchanged first.

        A frame is returned until it is finished or put off.
        """
        seen = {}
        for source in sources:
            state = state_of(source)
            if state is None:
                continue
            before = self._seen.get(source.name)
            seen[source.name] = before if before and before.state == state else _Seen(state, now)
        self._seen = seen
        arrivals = [
            Arrival(source, seen[source.name].since, seen[source.name].put_off)
            for source in sources
            if source.name in seen and self._is_due(seen[source.name], now)
        ]
        return sorted(arrivals, key=lambda arrival: arrival.since)

    def finish(self, name: str) -> None:
        """Note that a frame needs nothing more until its files change."""
        if name in self._seen:  # it may have gone since
            self._seen[name].finished = True

    def put_off(self, name: str) -> None:
        """Note that a frame could not be read yet."""
        if name in self._seen:
            self._seen[name].put_off = True

    def is_waiting(self) -> bool:
        """Return whether there are frames that may not be whole yet."""
        return any(not each.finished and not each.put_off for each in self._seen.values())

    def last_change(self) -> float | None:
        """Return when a frame was last seen to change; None where none was seen."""
        return max((each.since for each in self._seen.values()), default=None)

    def _is_due(self, each: _Seen, now: float) -> bool:
        wait = self._config.patience if each.put_off else self._config.settle
        return not each.finished and now - each.since >= wait


def state_of(source: FrameSource) -> State | None:
    """Return the state of a frame's files; None where one has just gone."""
    try:
        files = [(str(path), path.stat()) for path in source.files]
    except OSError:  # between the listing and now
        return None
    return tuple((name, each.st_size, each.st_mtime_ns, each.st_ino) for name, each in files)
