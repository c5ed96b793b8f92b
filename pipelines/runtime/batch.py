"""Run a step on many items: skip finished items, collect failures, report both."""

import dataclasses
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from joblib import delayed

from pipelines.contents import reason
from pipelines.errors import (
    FormatError,
    StaleOutputError,
    SymgraspError,
    WriteError,
    counted,
    error_sentence,
)
from pipelines.runtime.clusters import (
    CLUSTERS,
    WORKER_ENDED,
    WorkerEndedError,
    check_backend,
    one_by_one,
    workers_of,
)
from pipelines.runtime.progress import with_progress
from pipelines.storage.provenance import Stamp, is_finished, remove_stamped

log = logging.getLogger(__name__)

CHOSEN = 0  # value of `workers`
SUSPECTS = 2  # items per worker that are done one by one after a worker was killed
NO_MEMORY = "there is not enough memory for it; give fewer --workers"
PASSING = {WORKER_ENDED, NO_MEMORY}  # failures that need not happen again
Attempted = tuple[str | None, str | None]  # the note of an item, and the sentence of its failure


@dataclasses.dataclass(frozen=True)
class BatchOptions:
    """Options of a batch; none of them changes the written files.

    `workers`: processes at a time; 1 runs in this process, unless `backend` is a cluster; `CHOSEN`
    leaves the number to the stage, and is 1 for a stage that does not choose.
    """

    workers: int = 1
    backend: str = "loky"  # or `dask` or `ray` if installed
    overwrite: bool = False  # make existing outputs again
    dry_run: bool = False  # report the work, do nothing
    progress: bool = True  # show progress on stderr: a bar, or lines if it is no terminal
    most_chosen: int = 2  # most processes that a stage chooses

    @property
    def is_here(self) -> bool:
        """Whether the work is done in this process."""
        return self.workers <= 1 and self.backend not in CLUSTERS

    def for_items(self, count: int) -> "BatchOptions":
        """Return the options with at most one worker per item, as each worker loads its data."""
        return dataclasses.replace(self, workers=min(self.workers, max(1, count)))


@dataclasses.dataclass(frozen=True)
class WorkItem:
    """One output to make: name in reports, path, stamp, and arguments of the step.

    `files`: further files that the step writes; if one is lost, the item is not finished.
    """

    name: str
    target: Path
    stamp: Stamp
    arguments: tuple[Any, ...] = ()
    files: tuple[Path, ...] = ()


@dataclasses.dataclass
class StageReport:
    """Result of a stage: names of items done, skipped as finished, or failed with a sentence."""

    stage: str
    done: list[str] = dataclasses.field(default_factory=list)
    skipped: list[str] = dataclasses.field(default_factory=list)
    failed: dict[str, str] = dataclasses.field(default_factory=dict)
    notes: dict[str, str] = dataclasses.field(default_factory=dict)
    seconds: float = 0.0
    has_next: bool = True  # whether the usual next command can work on the outputs

    @property
    def exit_code(self) -> int:
        """0 if nothing failed, else 1."""
        return 1 if self.failed else 0

    @contextmanager
    def attempting(self, name: str) -> Iterator[None]:
        """Count `name` as done, or as failed with the sentence of the error in the block.

        Raises:
            WriteError: the result cannot be written, which would fail all others too.
        """
        try:
            yield
        except WriteError:
            raise
        except (SymgraspError, OSError) as error:
            self.failed[name] = error_sentence(error)
        else:
            self.done.append(name)

    def why_all_failed(self, predicate: str) -> str:
        """Return the sentence of a stage where all frames failed, with the first reason."""
        name, sentence = next(iter(self.failed.items()))
        return f"none of {counted(len(self.failed), 'frame')} {predicate}; {name}: {sentence}"

    def add(self, part: "StageReport", prefix: str = "") -> None:
        """Add the report of a part of the stage, with `prefix` before its names."""
        self.done += [f"{prefix}{name}" for name in part.done]
        self.skipped += [f"{prefix}{name}" for name in part.skipped]
        self.failed |= {f"{prefix}{name}": why for name, why in part.failed.items()}
        self.notes |= {f"{prefix}{name}": note for name, note in part.notes.items()}
        self.seconds += part.seconds


def run_batch(
    stage: str,
    items: Sequence[WorkItem],
    step: Callable[[WorkItem], str | None],
    options: BatchOptions,
    threads: Executor | None = None,
) -> StageReport:
    """Run `step` on every unfinished item, in `threads` if given.

    An error in `step`, or the end of its worker process, as for lack of memory, fails its item
    alone. Errors other than `SymgraspError`, `OSError` and `MemoryError` are called unforeseen, and
    `--verbose` shows their origin. A `WriteError` (no space or no permission to write) and an
    `ImportError` (a faulty installation) end the batch. `step` may return a note for the report;
    with several workers it must be picklable.

    Raises:
        UnknownNameError: no such backend.
        WriteError: the result of `step` cannot be written.
    """
    check_backend(options.backend)
    started, report = time.monotonic(), StageReport(stage)
    todo = _unfinished(items, options, report)
    if options.dry_run:
        report.notes.update({item.name: f"would write {item.target}" for item in todo})
        return report
    for item, (note, failure) in zip(
        todo, _outcomes(stage, todo, step, options, threads), strict=True
    ):
        if failure is not None:
            report.failed[item.name] = failure
            continue
        report.done.append(item.name)
        if note:
            report.notes[item.name] = note
    report.seconds = time.monotonic() - started
    return report


def drop_damaged(items: Sequence[WorkItem], options: BatchOptions) -> None:
    """Remove damaged targets of a cache, so that only these are made again; warn of them."""
    drop_stale(items, options, faults=(FormatError,))


def drop_stale(
    items: Sequence[WorkItem],
    options: BatchOptions,
    known: Iterable[Path] = (),
    faults: tuple[type[SymgraspError], ...] = (StaleOutputError, FormatError),
) -> None:
    """Remove stale and damaged targets, for outputs that are parts of another output.

    Parts without that other output are left over from an earlier run. `known`: existing parts;
    those that are no targets are removed too. `faults`: errors of the targets to remove. A warning
    counts the removed targets, unless the user overwrites.
    """
    removed = sorted({*known} - {item.target for item in items})
    for item in items:
        try:
            is_finished(item.target, item.stamp)
        except (StaleOutputError, FormatError) as error:
            if isinstance(error, faults):
                removed.append(item.target)
    if options.dry_run:
        return
    if not options.overwrite:
        warn_of_removed(removed)
    for part in removed:
        remove_stamped(part)


def warn_of_removed(parts: Sequence[Path]) -> None:
    """Warn that `parts` in one folder, which this run cannot use, are removed."""
    if parts:
        log.warning(
            "removed %s of an earlier run from %s: damaged, or made with other settings, inputs or "
            "version",
            counted(len(parts), "part"),
            parts[0].parent,
        )


def _unfinished(
    items: Sequence[WorkItem], options: BatchOptions, report: StageReport
) -> list[WorkItem]:
    todo = []
    for item in items:
        try:
            finished = is_finished(item.target, item.stamp, overwrite=options.overwrite)
        except Exception as error:  # content that no reader foresaw fails its item alone
            report.failed[item.name] = failure_sentence(error)
            continue
        if finished and all(file.exists() for file in item.files):
            report.skipped.append(item.name)
        else:
            todo.append(item)
    return todo


def _outcomes(
    stage: str,
    todo: Sequence[WorkItem],
    step: Callable[[WorkItem], str | None],
    options: BatchOptions,
    threads: Executor | None,
) -> Iterable[Attempted]:
    results: Iterator[Attempted]
    if not todo:
        return
    options, attempt = options.for_items(len(todo)), partial(_attempt, step)
    if threads is not None or options.is_here:
        results = (threads.map if threads else map)(attempt, todo)
    else:
        results = _outcomes_of_workers(todo, attempt, options)
    yield from with_progress(results, stage, len(todo)) if options.progress else results


def _outcomes_of_workers(
    todo: Sequence[WorkItem], attempt: Callable[[WorkItem], Attempted], options: BatchOptions
) -> Iterator[Attempted]:
    """Yield the outcomes in order; an item whose worker is killed fails alone.

    Nobody knows which item's worker was killed, so the next ones are done one by one.
    """
    done, workers = 0, max(1, options.workers)
    while done < len(todo):
        try:
            with workers_of(options.backend, workers) as run:
                for outcome in run(delayed(attempt)(item) for item in todo[done:]):
                    done += 1
                    yield outcome
        except WorkerEndedError:
            log.warning(WORKER_ENDED)
            for found in one_by_one(attempt, todo[done : done + SUSPECTS * workers]):
                done += 1
                yield found or (None, WORKER_ENDED)


def _attempt(step: Callable[[WorkItem], str | None], item: WorkItem) -> Attempted:
    """Return (note, None), or (None, the sentence of the failure)."""
    try:
        return step(item), None
    except (WriteError, ImportError):
        raise
    except Exception as error:  # see `run_batch`
        return None, failure_sentence(error)


def failure_sentence(error: Exception) -> str:
    """Return the sentence of an error that fails an item."""
    if isinstance(error, SymgraspError | OSError):
        return error_sentence(error)
    if isinstance(error, MemoryError):
        return NO_MEMORY
    log.info("unforeseen", exc_info=error)
    return f"unforeseen {type(error).__name__} ({reason(error)}); please report it with --verbose"
