"""A requested training, the files it owns, and the progress of an earlier run."""

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipelines.contents import reading, typed
from pipelines.errors import FormatError, SymgraspError, ValueRangeError, counted
from pipelines.storage.checkpoints import load_training
from pipelines.storage.files import refuse_folder_as_file
from pipelines.storage.provenance import COMPARED, Stamp, read_stamp, warn_of_other_version

log = logging.getLogger(__name__)

# Endings of files that a run owns in addition to its output.
CHECKPOINT, CURVES, LOGS = "checkpoint.safetensors", "curves.png", "logs"
FAULT = "fault.safetensors"  # the batch without a finite loss
TRAIN_AGAIN = "pass --overwrite to train again"
FEW = 5  # settings that a sentence names
UNSET = "unset"  # in place of the value of a setting that another version lacks
MOST_POINTS = 400  # points of a curve; a longer curve is thinned to half


@dataclass(frozen=True)
class RunRequest:
    """Options of a run that do not change its converged result."""

    seed: int = 0  # seed of everything drawn at random
    device: str = "auto"  # auto, cpu, cuda or cuda:N
    threads: int = 2  # CPU cores to use
    max_seconds: float | None = None  # time after which the run stops cleanly, None for no limit
    resume: bool = False  # continue an unfinished run
    overwrite: bool = False  # start again even if files exist
    progress: bool = False  # show a progress bar on stderr instead of lines
    loaders: int = 0  # processes that load batches ahead; 0 for a thread


@dataclass
class History:
    """Curves of one training, kept in the checkpoint so that a resumed run has whole curves."""

    every: int = 1  # steps that a point of `train` stands for
    # by term, means over `every` steps each
    train: dict[str, list[float]] = field(default_factory=dict)
    # by figure, pairs (steps done, value)
    val: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    pending: dict[str, float] = field(
        default_factory=dict
    )  # sums over the steps since the last point
    num_pending: int = 0

    def add_losses(self, losses: Mapping[str, float]) -> None:
        """Add the loss terms of one step."""
        self.pending = {name: self.pending.get(name, 0.0) + value for name, value in losses.items()}
        self.num_pending += 1
        if self.num_pending < self.every:
            return
        for name, value in self.pending.items():
            self.train.setdefault(name, []).append(value / self.num_pending)
        self.pending, self.num_pending = {}, 0
        if len(next(iter(self.train.values()))) >= MOST_POINTS:
            for name, means in self.train.items():
                pairs = zip(means[::2], means[1::2], strict=True)
                self.train[name] = [0.5 * (a + b) for a, b in pairs]
            self.every *= 2

    def add_figures(self, steps: int, figures: Mapping[str, float]) -> None:
        """Add the figures of a validation after `steps` steps."""
        for name, value in figures.items():
            self.val.setdefault(name, []).append((steps, value))

    def curve(self, term: str) -> list[tuple[float, float]]:
        """Return points (steps done, mean) of a loss term."""
        values = self.train.get(term, [])
        return [((i + 0.5) * self.every, value) for i, value in enumerate(values)]


@dataclass
class Progress:
    """Progress of a run: the contents of a checkpoint without its tensors."""

    epoch: int = 0
    step: int = 0  # steps done in this epoch
    total_steps: int = 0
    seconds: float = 0.0
    best: float | None = None  # best figure at the end of an epoch
    figures: dict[str, float] = field(default_factory=dict)  # of the best weights
    kept: dict[str, float] = field(default_factory=dict)  # of the weights in the output
    finished: bool = False
    history: History = field(default_factory=History)

    @classmethod
    def of(cls, content: Mapping[str, Any], path: Path) -> "Progress":
        """Return the progress that `dataclasses.asdict` made a JSON object of, in the file `path`.

        Raises:
            FormatError: a value has another type or is negative.
        """
        with reading(path, "the progress of the training", TRAIN_AGAIN):
            progress: Progress = typed(cls, dict(content))
            done = progress.epoch, progress.step, progress.total_steps, progress.history.every - 1
            if min(done) < 0:
                raise ValueError("a number of steps is negative")
            return progress


def file_of_run(output: Path, kind: str) -> Path:
    """Return the path of a file, or the `LOGS`, of the run that writes `output`."""
    return output.with_name(f"{output.stem}.{kind}")


def find_progress(output: Path, stamp: Stamp, request: RunRequest) -> Progress | None:
    """Return the progress of an earlier run that is finished or to be resumed, else None.

    With --resume and --overwrite, a run of the same settings is resumed, any other run and a
    damaged checkpoint are replaced.

    Raises:
        ValueRangeError: `output` has another ending than .safetensors.
        SymgraspError: `output` is a folder, there is an earlier run and neither --resume nor
            --overwrite is given, or the earlier run had other settings and cannot be resumed.
        FormatError: the checkpoint is damaged, and --overwrite is not given.
    """
    if output.suffix != ".safetensors":
        raise ValueRangeError("--out", output, "NAME.safetensors")
    refuse_folder_as_file(output)
    checkpoint = file_of_run(output, CHECKPOINT)
    if not (checkpoint.exists() or output.exists()):
        return None
    if request.overwrite and not request.resume:
        return None  # whatever the checkpoint holds: it may be damaged
    try:
        return _progress_to_resume(output, checkpoint, stamp, request)
    except FormatError as error:
        if not request.overwrite:
            raise
        warn_of_damage(error)
        return None


def warn_of_damage(error: FormatError) -> None:
    """Warn that a run with --overwrite does not resume from its damaged checkpoint."""
    log.warning("the training starts again, as --overwrite allows: %s", error)


def _progress_to_resume(
    output: Path, checkpoint: Path, stamp: Stamp, request: RunRequest
) -> Progress | None:
    """Return the progress of an earlier run, None if it is to be replaced; see `find_progress`."""
    found = read_stamp(checkpoint) or {} if checkpoint.exists() else {}
    changed = _changes(found, stamp)
    if request.overwrite and changed:
        return None
    if not checkpoint.exists():
        raise SymgraspError(
            f"{output} exists without {checkpoint.name}; pass --overwrite to train it again"
        )
    if changed:
        wanted = stamp.as_json()
        changes = [_change(key, found.get(key), wanted[key]) for key in changed]
        raise SymgraspError(
            f"{checkpoint} was made with {' and '.join(changes)}; "
            "give the same settings and data to resume it, or pass --overwrite to start again"
        )
    warn_of_other_version(found, stamp)
    progress = Progress.of(load_training(checkpoint).progress, checkpoint)
    if progress.finished and not output.exists():  # weights are gone; the checkpoint has them
        progress.finished = False
        return progress
    if not request.resume and not progress.finished:
        raise SymgraspError(
            f"{checkpoint} holds an unfinished training; "
            "pass --resume to continue it or --overwrite to start again"
        )
    return progress


def _changes(found: Mapping[str, Any], stamp: Stamp) -> list[str]:
    """Return the compared fields of `stamp` that differ in the stamp `found` of a file."""
    wanted = stamp.as_json()
    return [key for key in COMPARED if found.get(key) != wanted[key]]


def _change(key: str, found: object, wanted: object) -> str:
    """Return the words on a compared field of a stamp that differs, with the differing values."""
    if key == "inputs":
        return "other data"
    old, new = _flat(found), _flat(wanted)
    names = [name for name in sorted({**old, **new}) if old.get(name) != new.get(name)]
    values = [f"{name} = {old.get(name, UNSET)}, now {new.get(name, UNSET)}" for name in names]
    more = [f"{len(values) - FEW} more"] if len(values) > FEW else []
    return f"another {key} ({'; '.join([*values[:FEW], *more]).removeprefix(' = ')})"


def _flat(value: object, name: str = "") -> dict[str, str]:
    """Return the values in nested mappings as JSON, by their dotted names."""
    if not isinstance(value, Mapping):
        return {name: json.dumps(value)}
    parts = (_flat(each, f"{name}.{key}".removeprefix(".")) for key, each in value.items())
    return {key: text for part in parts for key, text in part.items()}


def remove_other_weights(output: Path, stamp: Stamp) -> None:
    """Remove weights of another run, which would pass for those of a new run that has none yet."""
    if not output.exists():
        return
    try:
        is_own = not _changes(read_stamp(output) or {}, stamp)
    except FormatError:  # damaged
        is_own = False
    if not is_own:
        output.unlink()


def refuse_own_start(init: Path | None, output: Path) -> None:
    """Raise ValueRangeError if a training would start from the file that it writes.

    Once the file is written, the training could not resume: its start would be another one.
    """
    if init is not None and init.exists() and output.exists() and init.samefile(output):
        raise ValueRangeError("--init", init, "another file than --out, such as a copy")


def describe(progress: Progress) -> str:
    """Return the number of steps and the figures of the kept weights, in one line."""
    figures = ", ".join(f"{name} {value:.4g}" for name, value in progress.kept.items())
    kept = f"best on unseen scenes: {figures}" if figures else "no weights are written yet"
    state = "finished" if progress.finished else "stopped by its time limit, --resume continues"
    steps = counted(progress.total_steps, "step")
    return f"{steps} in {progress.seconds / 60:.1f} min, {state}; {kept}"
