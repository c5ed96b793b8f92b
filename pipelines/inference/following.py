"""The frames that come into a folder, worked on as they come, and the output of all so far."""

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf

from pipelines.configs import WatchConfig
from pipelines.errors import SymgraspError
from pipelines.frames.rgbd import FrameSource
from pipelines.grasp_files import grasps_file
from pipelines.inference.pictures import draw_missing
from pipelines.inference.watching import Arrival, Clock, Lister, Watcher
from pipelines.inference.work import (
    STAGE,
    Work,
    earlier_frames,
    has_shard,
    infer_frame,
    refuse_stale,
)
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch

log = logging.getLogger(__name__)

LONGEST_PAUSE = 1.0  # seconds until a signal is heeded
LONGEST_END = 5.0  # seconds that the output may take after a signal
WRITING_SHARE = 9  # the output's time is waited this many times, as it grows with all frames
LISTING_SHARE = 4  # a listing's time is waited this many times, so that large folders cost little


@dataclass(frozen=True)
class Followed:
    """The result of one frame.

    Attributes:
        name: the frame's.
        status: `ok`, `empty` or `failed`.
        grasps: how many were found.
        seconds: from when its files were last seen to change until its results could be read.
        text: the file of its results, or why there is none.
    """

    name: str
    status: str
    grasps: int
    seconds: float
    text: str


class _TakesTooLong(Exception):  # noqa: N818 - it ends a thread of ours
    """The output is not put together before the process has to end."""


@dataclass
class Follower:
    """The state of all frames so far."""

    work: Work
    watch: WatchConfig
    options: BatchOptions
    notify: Callable[[Followed], None]
    clock: Clock
    # The same for all frames: the C library keeps what a thread gave back for the next thread, and
    # new threads for each two frames came to hold 150 MB more so.
    threads: Executor
    beside: Executor
    items: dict[str, WorkItem] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    pending: dict[str, tuple[Arrival, WorkItem, str]] = field(default_factory=dict)  # put off
    report: StageReport = field(default_factory=lambda: StageReport(STAGE))
    listed: Sequence[FrameSource] = ()
    is_changed: bool = False  # since the output was put together
    writing: Future[None] | None = None  # while it is
    begun: float = 0.0  # when that began, the last time
    rested: float = 0.0  # when it may begin again
    deadline: float = inf  # by which it must have ended

    def __post_init__(self) -> None:
        self.watcher = Watcher(self.watch)
        find = partial(self.work.find, may_be_empty=True)
        self.lister = Lister(find, self.work.settings.paths.frames, self.watch)
        self.started = self.active = self.clock.now()

    def begin(self, *, overwrite: bool) -> None:
        """Take up what an earlier run left, and load the networks.

        Raises:
            StaleOutputError: that run had other settings, or its frames are lost.
        """
        self.listed = self.work.find(may_be_empty=True)
        if overwrite:
            grasps_file.remove_shards(self.work.output)
        else:
            self.items = earlier_frames(self.work)
            refuse_stale(self.work, {*self.items, *(source.name for source in self.listed)})
        self.is_changed = bool(self.items) and not self.work.output.exists()
        self.work.settings.planner()
        self.started = self.active = self.clock.now()

    def go_on(self) -> None:
        """Look once; work on what is whole, or wait."""
        looked = self.clock.now()
        arrivals = self._arrivals()
        if arrivals:
            self._work_on(arrivals[: self.options.workers])
            self.active = self.clock.now()
            return
        now = self.clock.now()
        if self.writing is not None and self.writing.done():
            self._await_output()
        is_quiet = now - self.active >= self.watch.quiet and now >= self.rested
        if self.is_changed and is_quiet and self.writing is None:
            self._put_together()
        pause = max(self.watch.poll, LISTING_SHARE * (now - looked))
        self.clock.wait(min(pause, LONGEST_PAUSE))

    def is_timed_out(self) -> bool:
        """Return whether no frame came or changed for as long as the user would wait."""
        if self.watcher.is_waiting():
            return False
        active = max(self.active, self.watcher.last_change() or self.active)
        return self.clock.now() - active >= self.watch.timeout

    def end(self, *, is_stopped: bool) -> StageReport:
        """Put the output together and return the report; if it `is_stopped`, do not take long."""
        self.deadline = self.clock.now() + (LONGEST_END if is_stopped else inf)
        names = {source.name for source in self.listed}
        for name in sorted(names & set(self.pending)):
            arrival, item, sentence = self.pending[name]
            self._conclude(name, arrival, item, sentence)
        try:
            if self.is_changed:
                self._put_together()
            self._await_output()
        except _TakesTooLong:
            log.warning(
                "%s is not of all frames: that would take over %g s; the same command without "
                "--watch puts it together",
                self.work.output,
                LONGEST_END,
            )
        self.report.failed = {name: why for name, why in self.failed.items() if name in names}
        self.report.seconds = self.clock.now() - self.started
        return self.report

    def _arrivals(self) -> list[Arrival]:
        try:
            self.listed = self.lister.look(self.clock.now())
        except (SymgraspError, OSError) as error:  # the folder may be back in a moment
            log.warning("cannot look for frames: %s", error)
            return []
        # A frame that has gone since it could not be read keeps the result that it had.
        names = {source.name for source in self.listed}
        self.pending = {name: each for name, each in self.pending.items() if name in names}
        return self.watcher.look(self.listed, self.clock.now())

    def _work_on(self, arrivals: Sequence[Arrival]) -> None:
        items = self.work.items([arrival.source for arrival in arrivals])
        if any(item.name in self.items for item in items):
            self._await_output()  # which is made of the parts that are now written anew
        finished = [item for item in items if has_shard(item)]
        todo = [item for item in items if item not in finished]
        step = partial(infer_frame, settings=self.work.settings)
        # Over the shards of earlier files: these stay until there is another result.
        options = replace(self.options, overwrite=True)
        report = run_batch(STAGE, todo, step, options, self.threads)
        self.report.notes.update(report.notes)
        for arrival, item in zip(arrivals, items, strict=True):
            sentence = report.failed.get(item.name)
            if sentence is not None and not arrival.is_last_try:
                self.watcher.put_off(item.name)
                self.pending[item.name] = (arrival, item, sentence)
            elif item in finished:
                self._keep(item, self.report.skipped)
            else:
                if sentence is not None:
                    item.target.unlink(missing_ok=True)  # of files that are no more
                self._conclude(item.name, arrival, item, sentence)
        found = [(item, item.target, 0) for item in finished]
        for name, why in draw_missing(self.work.settings, found, self.options).items():
            log.warning("%s: %s", name, why)

    def _conclude(self, name: str, arrival: Arrival, item: WorkItem, sentence: str | None) -> None:
        """Note and report the result of a frame; `sentence` says why it failed, if it did."""
        seconds = self.clock.now() - arrival.since
        if sentence is not None:
            self._keep(item, [])
            self.failed[name] = sentence
            self.notify(Followed(name, "failed", 0, seconds, sentence))
            return
        self._keep(item, self.report.done)
        found = grasps_file.read_shard(item.target)
        self.notify(Followed(name, found.status, len(found.grasps), seconds, str(item.target)))

    def _keep(self, item: WorkItem, names: list[str]) -> None:
        self.watcher.finish(item.name)
        self.pending.pop(item.name, None)
        self.failed.pop(item.name, None)
        self.items[item.name] = item
        self.is_changed = True
        if item.name not in names:
            names.append(item.name)

    def _put_together(self) -> None:
        """Write the output of all frames so far, as `infer` would order them; those gone first.

        It takes a hundredth of a second a frame, in which the next one is not to wait.
        """
        self._await_output()
        self._forget_lost()
        listed = [source.name for source in self.listed]
        gone = [name for name in self.items if name not in {*listed, *self.failed}]
        order = [*gone, *(name for name in listed if name in self.items)]
        items = [self.items[name] for name in order]
        self.begun = self.clock.now()
        arguments = items, dict(self.failed), self._check_deadline
        self.writing = self.beside.submit(self.work.put_together, *arguments)
        self.is_changed = False

    def _check_deadline(self) -> None:
        if self.clock.now() > self.deadline:
            raise _TakesTooLong

    def _forget_lost(self) -> None:
        """Leave out the frames whose parts somebody removed, rather than fail without them."""
        for name in set(self.items) - set(self.failed):
            if not self.items[name].target.exists():
                log.warning("%s: its part is not there any more, it is left out", name)
                del self.items[name]

    def _await_output(self) -> None:
        """Wait until the output is put together, if it is being so; raise its error."""
        writing, self.writing = self.writing, None
        if writing is not None:
            writing.result()
            now = self.clock.now()
            self.rested = now + WRITING_SHARE * (now - self.begun)
