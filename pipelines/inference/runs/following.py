"""Grasps of frames as they arrive in a folder, and the output of all frames so far."""

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
from pipelines.inference.runs.earlier_runs import (
    earlier_frames,
    has_part,
    refuse_stale,
    warn_of_lost_parts,
)
from pipelines.inference.runs.infer_run import STAGE, InferRun, infer_frame
from pipelines.inference.runs.pictures import draw_missing
from pipelines.inference.runs.watching import Arrival, Clock, Lister, Watcher
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch

log = logging.getLogger(__name__)

LONGEST_PAUSE = 1.0  # seconds until a signal takes effect
LONGEST_END = 5.0  # seconds that writing the output may take after a signal
WRITING_SHARE = 9  # pause after writing the output, times the writing, which grows with all frames
LISTING_SHARE = 4  # pause after a listing, times the listing, so that large folders cost little


@dataclass(frozen=True)
class FrameOutcome:
    """The result of one frame.

    Attributes:
        name: name of the frame.
        status: `ok`, `empty` or `failed`.
        grasps: number of grasps.
        seconds: from the last seen change of the frame's files until the results can be read.
        text: the file of the results, or the reason why there is none.
    """

    name: str
    status: str
    grasps: int
    seconds: float
    text: str


class _TakesTooLong(Exception):  # noqa: N818 - it ends a thread of ours
    """The output is not complete before the process has to end."""


@dataclass
class Follower:
    """The work of `infer --watch`: frames as they arrive, their results, and the output.

    `begin` comes first, then `poll` again and again, and `end` last.

    Attributes:
        run: the run of `infer` whose output is kept up to date.
        watch: waiting times.
        options: options of the batches of frames.
        notify: called with the outcome of each frame.
        clock: current time and waiting.
        threads: process frames. Always the same ones: the C library keeps memory that a thread
            frees, and new threads for each two frames held 150 MB more.
        writer: writes the output.
        items: newest result of each frame, by name, failed frames included.
        failed: sentence on the fault of each failed frame, by name.
        pending: frames that could not be read at the first try, by name.
        report: the report to return at the end.
        listed: frames of the folder at the last listing.
        trouble: why the last listing failed; empty if it did not.
        is_changed: whether results changed since the output was written.
        writing: the running writing of the output; None if there is none.
        writing_began: time at which the last writing began.
        next_writing: time from which the next writing may begin.
        deadline: time at which a writing must have ended.
    """

    run: InferRun
    watch: WatchConfig
    options: BatchOptions
    notify: Callable[[FrameOutcome], None]
    clock: Clock
    threads: Executor
    writer: Executor
    items: dict[str, WorkItem] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    pending: dict[str, tuple[Arrival, WorkItem, str]] = field(default_factory=dict)
    report: StageReport = field(default_factory=lambda: StageReport(STAGE))
    listed: Sequence[FrameSource] = ()
    trouble: str = ""
    is_changed: bool = False
    writing: Future[None] | None = None
    writing_began: float = 0.0
    next_writing: float = 0.0
    deadline: float = inf

    def __post_init__(self) -> None:
        self.watcher = Watcher(self.watch)
        find = partial(self.run.find, may_be_empty=True)
        self.lister = Lister(find, self.run.settings.paths.frames, self.watch)
        self.started = self.last_work = self.clock.now()

    def begin(self, *, overwrite: bool) -> None:
        """Take over the parts of an earlier run, and load the networks.

        Raises:
            StaleOutputError: the earlier run had other settings.
            SymgraspError: frames of the earlier run are missing.
        """
        self.listed = self.run.find(may_be_empty=True)
        if overwrite:
            warn_of_lost_parts(self.run, self.run.items(self.listed))
            grasps_file.remove_parts(self.run.output)
        else:
            self.items = earlier_frames(self.run)
            refuse_stale(self.run, {*self.items, *(source.name for source in self.listed)})
        self.is_changed = bool(self.items) and not self.run.output.exists()
        self.run.settings.planner()
        self.started = self.last_work = self.clock.now()

    def poll(self) -> None:
        """List the folder once; work on the complete frames, or wait."""
        looked = self.clock.now()
        arrivals = self._arrivals()
        if arrivals:
            self._work_on(arrivals[: self.options.workers])
            self.last_work = self.clock.now()
            return
        now = self.clock.now()
        if self.writing is not None and self.writing.done():
            self._await_output()
        is_quiet = now - self.last_work >= self.watch.quiet and now >= self.next_writing
        if self.is_changed and is_quiet and self.writing is None:
            self._start_writing()
        pause = max(self.watch.poll, LISTING_SHARE * (now - looked))
        self.clock.wait(min(pause, LONGEST_PAUSE))

    def is_timed_out(self) -> bool:
        """Return whether no frame came or changed for `timeout` seconds."""
        if self.watcher.is_waiting():
            return False
        last_work = max(self.last_work, self.watcher.last_change() or self.last_work)
        return self.clock.now() - last_work >= self.watch.timeout

    def end(self, *, is_stopped: bool) -> StageReport:
        """Write the output and return the report; if `is_stopped`, within `LONGEST_END` seconds."""
        self.deadline = self.clock.now() + (LONGEST_END if is_stopped else inf)
        names = {source.name for source in self.listed}
        for name in sorted(names & set(self.pending)):
            arrival, item, sentence = self.pending[name]
            self._report(name, arrival, item, sentence)
        try:
            if self.is_changed:
                self._start_writing()
            self._await_output()
        except _TakesTooLong:
            log.warning(
                "%s does not hold all frames, as writing it takes over %g s; run the same command "
                "without --watch to complete it",
                self.run.output,
                LONGEST_END,
            )
        self.report.failed = {name: why for name, why in self.failed.items() if name in names}
        self.report.seconds = self.clock.now() - self.started
        return self.report

    def _arrivals(self) -> list[Arrival]:
        try:
            self.listed = self.lister.frames(self.clock.now())
        except (SymgraspError, OSError) as error:  # the folder may soon be back
            if str(error) != self.trouble:
                log.warning("cannot look for frames: %s", error)
            self.trouble = str(error)
            return []
        self.trouble = ""
        # A frame that is gone after a failed reading keeps its earlier result.
        names = {source.name for source in self.listed}
        self.pending = {name: each for name, each in self.pending.items() if name in names}
        return self.watcher.arrivals(self.listed, self.clock.now())

    def _work_on(self, arrivals: Sequence[Arrival]) -> None:
        items = self.run.items([arrival.source for arrival in arrivals])
        if any(item.name in self.items for item in items):
            self._await_output()  # it reads the parts that are now overwritten
        finished = [item for item in items if has_part(item)]
        todo = [item for item in items if item not in finished]
        step = partial(infer_frame, settings=self.run.settings)
        # Parts of earlier files are overwritten only once there is a new result.
        options = replace(self.options, overwrite=True)
        report = run_batch(STAGE, todo, step, options, self.threads)
        self.report.notes.update(report.notes)
        for arrival, item in zip(arrivals, items, strict=True):
            sentence = report.failed.get(item.name)
            if sentence is not None and not arrival.is_last_try:
                self.watcher.put_off(item.name)
                self.pending[item.name] = (arrival, item, sentence)
            elif item in finished:
                done = self.report.done  # by this run, before the frame was gone for a while
                self._record(item, done if item.name in done else self.report.skipped)
            else:
                if sentence is not None:
                    item.target.unlink(missing_ok=True)  # a part of earlier files
                self._report(item.name, arrival, item, sentence)
        found = [(item, item.target, 0) for item in finished]
        for name, why in draw_missing(self.run.settings, found, self.options).items():
            log.warning("%s: %s", name, why)

    def _report(self, name: str, arrival: Arrival, item: WorkItem, sentence: str | None) -> None:
        """Note and report the result of a frame; `sentence`: reason of its failure, or None."""
        seconds = self.clock.now() - arrival.since
        if sentence is not None:
            self._record(item, [])
            self.failed[name] = sentence
            self.notify(FrameOutcome(name, "failed", 0, seconds, sentence))
            return
        self._record(item, self.report.done)
        found = grasps_file.read_part(item.target)
        self.notify(FrameOutcome(name, found.status, len(found.grasps), seconds, str(item.target)))

    def _record(self, item: WorkItem, names: list[str]) -> None:
        """Note the newest result of a frame; `names`: of the frames with such a result."""
        self.watcher.finish(item.name)
        self.pending.pop(item.name, None)
        self.failed.pop(item.name, None)
        self.items[item.name] = item
        self.is_changed = True
        for counted in (self.report.done, self.report.skipped):  # each frame counts once
            if counted is not names and item.name in counted:
                counted.remove(item.name)
        if item.name not in names:
            names.append(item.name)

    def _start_writing(self) -> None:
        """Start writing the output of all frames so far: removed frames first, then as in `infer`.

        Writing takes 0.01 s per frame, and runs in a thread so that the next frame does not wait.
        """
        self._await_output()
        self._leave_out_missing()
        listed = [source.name for source in self.listed]
        gone = [name for name in self.items if name not in {*listed, *self.failed}]
        order = [*gone, *(name for name in listed if name in self.items)]
        items = [self.items[name] for name in order]
        self.writing_began = self.clock.now()
        arguments = items, dict(self.failed), self._check_deadline
        self.writing = self.writer.submit(self.run.assemble, *arguments)
        self.is_changed = False

    def _check_deadline(self) -> None:
        if self.clock.now() > self.deadline:
            raise _TakesTooLong

    def _leave_out_missing(self) -> None:
        """Leave out the frames whose parts were removed by others, instead of failing."""
        for name in set(self.items) - set(self.failed):
            if not self.items[name].target.exists():
                log.warning("%s: its part is missing, the frame is left out", name)
                del self.items[name]

    def _await_output(self) -> None:
        """Wait until the output is written, if it is being written; raise errors of the writing."""
        writing, self.writing = self.writing, None
        if writing is not None:
            writing.result()
            now = self.clock.now()
            self.next_writing = now + WRITING_SHARE * (now - self.writing_began)
