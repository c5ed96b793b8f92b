"""Which frames of a folder are whole while a camera still writes into it.

A frame is whole when none of its files has changed for a while, as seen from here: the clock of a
camera or a file server may be another. What cannot be read then may be a pair whose second image is
late, so it is read once more after a longer while before it has failed. A frame whose files change
again is a new one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pipelines.configs import WatchConfig
from pipelines.formats.rgbd import FrameSource

State = tuple[tuple[str, int, int, int], ...]  # path, size, time of change, file number


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
    """Return what shows that a frame's files change; None where one has just gone."""
    try:
        files = [(str(path), path.stat()) for path in source.files]
    except OSError:  # between the listing and now
        return None
    return tuple((name, each.st_size, each.st_mtime_ns, each.st_ino) for name, each in files)
