"""Table IV: the method with one part left out at a time: `python -m benchmarks.ablations ROOT`.

Makes a training set, trains two detectors and, for each row and seed, a network, infers and
evaluates on ROOT, the benchmark of `make eval`, and writes OUT/ablations.json, OUT/table.json (for
`evaluate --table`) and OUT/ablations.md again after each row has all its seeds. Commands of
`symgrasp` do all the work. Finished steps are not repeated: each step leaves a record of its
command, and an interrupted step resumes as its command does.
"""

import argparse
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.ablation_table import (
    ABLATIONS,
    Row,
    ablation_page,
    report_table,
    rows_named,
    summary,
)
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import MissingInputError, SymgraspError, ValueRangeError
from pipelines.storage.files import read_json, write_json, write_text
from pipelines.storage.provenance import digest, make_stamp

SYMGRASP = (sys.executable, "-c", "from symgrasp_cli.main import main; main()")
REFINED, UNREFINED, UNCUT = "refined", "unrefined", "uncut"
FILES = ("models", "scenes", "grasp_label", "objects.json")
SHARED = {REFINED: (), UNREFINED: (*FILES, "symmetry"), UNCUT: FILES}  # shared with the first root
BATCH, DETECTOR_BATCH = 12, 4
DECAYS = 20  # drops of the learning rate by a tenth, to 0.12 of its start value
GOES_ON = "the same command continues from there"
Run = Callable[[Sequence[str]], None]
Count = Callable[[Path, int], int]


@dataclass(frozen=True)
class Budget:
    """Effort spent on every row."""

    scenes: int = 60
    views: int = 8
    objects: int = 72
    steps: int = 4000  # steps of the network, 12 regions each
    detector_steps: int = 1200  # steps of the detector, 4 frames each
    workers: int = 2


@dataclass(frozen=True)
class Step:
    """One command of symgrasp, with a record called `name`."""

    name: str
    command: tuple[str, ...]

    @property
    def output(self) -> Path:
        """Output of the command, or the dataset that it writes into."""
        is_named = "--out" in self.command
        return Path(self.command[self.command.index("--out") + 1 if is_named else 1])


class Ablations:
    """The steps to a table, one after the other.

    `root`: root of the benchmark. `count_regions`: from a packed folder and a seed to the number of
    training regions. `chosen`: the rows to make.
    """

    def __init__(
        self,
        root: Path,
        out: Path,
        budget: Budget,
        count_regions: Count,
        chosen: Sequence[Row] = ABLATIONS,
    ) -> None:
        self.root, self.out, self.budget = root, out, budget
        self.count_regions, self.chosen = count_regions, chosen

    def rows(self, seeds: Sequence[int]) -> Iterator[tuple[Row, Iterator[Step]]]:
        """Yield each row and its steps; a step may read the files of earlier steps."""
        for row in self.chosen:
            yield row, self._steps(row, seeds)

    def _steps(self, row: Row, seeds: Sequence[int]) -> Iterator[Step]:
        if row is ABLATIONS[0]:
            yield from self._labels()
        for seed in seeds:
            yield from self._row(row, seed)

    def folder(self, seed: int) -> Path:
        """Return the folder of all trainings with `seed`."""
        return self.out / f"seed{seed}"

    def report(self, row: Row, seed: int) -> Path:
        """Return the path of the report of a row."""
        return self.folder(seed) / row.key / "report.json"

    def compared(self, row: Row, seed: int) -> Path:
        """Return the path of the comparison of a row with its base."""
        return self.folder(seed) / row.key / "compare.json"

    def is_finished(self, row: Row, seeds: Sequence[int]) -> bool:
        """Return whether all files that the table needs for a row exist."""
        files = [self.report(row, seed) for seed in seeds]
        if row.base is not None:
            files += [self.compared(row, seed) for seed in seeds]
            if not all(self.is_finished(base, seeds) for base in ABLATIONS if base.key == row.base):
                return False
        return all(path.is_file() for path in files)

    def _labels(self) -> Iterator[Step]:
        budget, workers = self.budget, ("--workers", self.budget.workers)
        root = self.out / REFINED
        kind = ("--split", "train", "--sensor", "mixed", "--no-collision-labels")
        scenes = ("--scenes-per-split", budget.scenes, "--views", budget.views)
        objects = ("--objects", budget.objects, "--size", "640x480", "--grasp-points", 48)
        # The benchmark's seed, so that the objects of its split `seen` are training objects.
        drawn = (*kind, *scenes, *objects, "--seed", 0)
        yield self._step("synthesize", "synthesize", root, *drawn, *workers)
        for labels, shared in SHARED.items():
            root = self.out / labels
            cut = ("--no-cut",) if labels == UNCUT else ()
            copies = ("--no-symmetry",) if labels == UNREFINED else ()
            link(self.out / REFINED, root, shared)
            if "symmetry" not in shared:
                yield self._step(f"annotate {labels}", "annotate-symmetry", root, *cut, *workers)
            yield self._step(f"refine {labels}", "refine-grasps", root, *copies, *workers)
            packed = ("--out", self.packed(labels))
            yield self._step(f"pack {labels}", "pack", root, *packed, *workers)

    def packed(self, labels: str) -> Path:
        """Return the folder of the packed regions with `labels`."""
        return self.out / "packed" / labels

    def _row(self, row: Row, seed: int) -> Iterator[Step]:
        folder = self.folder(seed)
        labels = UNCUT if row.labels == UNCUT else REFINED
        detector = self.out / f"detector_{labels}.safetensors"
        network = folder / f"network_{row.network or row.key}.safetensors"
        yield self._detector(labels, detector)
        if row.network is None:
            yield self._network(row, network, seed)
        weights = ("--detector", detector, "--network", network)
        grasps, name = folder / row.key / "grasps.h5", f"{row.key} {seed}"
        options = (*weights, "--seed", seed, *row.infer)
        yield self._step(f"infer {name}", "infer", self.root, "--out", grasps, *options)
        report, workers = self.report(row, seed), ("--workers", self.budget.workers)
        out = ("--dataset", self.root, "--out", report)
        yield self._step(f"evaluate {name}", "evaluate", grasps, *out, *workers)
        if row.base is not None:
            base = folder / row.base / report.name
            out = ("--out", self.compared(row, seed))
            yield self._step(f"compare {name}", "compare", base, report, *out)

    def _detector(self, labels: str, out: Path) -> Step:
        """Return the training of a detector, one for all seeds, since rows compare networks."""
        frames = self.budget.scenes * self.budget.views * 9 // 10  # a tenth is held out
        lasting = epochs(self.budget.detector_steps, frames // DETECTOR_BATCH)
        options = ("--batch-size", DETECTOR_BATCH, "--workers", self.budget.workers, *lasting)
        return self._training(f"finetune {labels}", "finetune-detector", labels, out, 0, options)

    def _network(self, row: Row, out: Path, seed: int) -> Step:
        regions = self.count_regions(self.packed(row.labels), seed)
        lasting = epochs(self.budget.steps, regions // BATCH)
        options = ("--batch-size", BATCH, *lasting, *row.train)
        packed = self.packed(row.labels).relative_to(self.out)
        return self._training(f"train {row.key}", "train", packed, out, seed, options)

    def _training(
        self,
        name: str,
        command: str,
        source: Path | str,
        out: Path,
        seed: int,
        options: Sequence[object],
    ) -> Step:
        last = ("--out", out, *options, "--seed", seed, "--resume")
        return self._step(f"{name} {seed}", command, self.out / source, *last)

    def _step(self, name: str, *command: object) -> Step:
        return Step(name.replace(" ", "_"), tuple(map(str, command)))


def epochs(steps: int, steps_per_epoch: int) -> tuple[object, ...]:
    """Return the options of a training that lasts `steps`, to the next whole epoch."""
    count = max(1, round(steps / max(1, steps_per_epoch)))
    return "--epochs", count, "--decay-epochs", f"{count / DECAYS:g}"


def link(source: Path, root: Path, names: Sequence[str]) -> None:
    """Make `root` a dataset that shares the files and folders `names` with `source`."""
    root.mkdir(parents=True, exist_ok=True)
    for name in names:
        if not (root / name).is_symlink():
            (root / name).symlink_to((source / name).resolve())


def perform(steps: Iterator[Step], records: Path, run: Run) -> None:
    """Run the steps without a record, or without their output.

    Raises:
        SymgraspError: the record of a step has another command, or a command failed.
    """
    for step in steps:
        record = records / f"{step.name}.json"
        if record.is_file():
            if read_json(record).get("command") != list(step.command):
                raise SymgraspError(
                    f"{record} has another command than `symgrasp {shlex.join(step.command)}`; "
                    f"give the same budget, or name another --out than {records.parent}"
                )
            if step.output.exists():
                continue
        sys.stderr.write(f"== symgrasp {shlex.join(step.command)}\n")
        started, busy = time.monotonic(), cpu_seconds()
        run(step.command)
        seconds, cpu = time.monotonic() - started, cpu_seconds() - busy
        taken = {"seconds": round(seconds, 1), "cpu_seconds": round(cpu, 1)}
        write_json(record, {"command": list(step.command), **taken})


def make_table(work: Ablations, seeds: Sequence[int], run: Run) -> str:
    """Do all steps, write the table after each finished row, and return it.

    Rows that an earlier run finished with these seeds stay in the table.
    """
    text = ""
    for _, steps in work.rows(seeds):
        perform(steps, work.out / "steps", run)
        text = write_tables(work, [row for row in ABLATIONS if work.is_finished(row, seeds)], seeds)
    return text


def cpu_seconds() -> float:
    """Return the processor seconds of finished child processes."""
    times = os.times()
    return times.children_user + times.children_system


def run_symgrasp(command: Sequence[str]) -> None:
    """Run a command of symgrasp in a separate process, without its tables."""
    with subprocess.Popen([*SYMGRASP, *command], stdout=subprocess.DEVNULL) as process:
        try:
            code = process.wait()
        except BaseException:
            process.terminate()
            process.wait()  # it leaves a checkpoint, and no process remains
            raise
    if code:
        raise SymgraspError(f"`symgrasp {command[0]}` ended with {code}; {GOES_ON}")


def trained_regions(packed: Path, seed: int) -> int:
    """Return the number of regions of `packed` that a training with `seed` does not hold out."""
    from pipelines.configs import TrainConfig  # noqa: PLC0415 - torch is slow to load
    from pipelines.train import region_sets  # noqa: PLC0415

    chosen, _ = region_sets(packed, None, TrainConfig(), seed)
    return 0 if chosen is None else len(chosen.indices)


def write_tables(work: Ablations, rows: Sequence[Row], seeds: Sequence[int]) -> str:
    """Write ablations.json, table.json and ablations.md of the finished rows; return the page."""
    reports = {row.key: [work.report(row, seed) for seed in seeds] for row in rows}
    based = [row for row in rows if row.base is not None]
    compared = {row.key: [work.compared(row, seed) for seed in seeds] for row in based}
    files = [path for paths in (*reports.values(), *compared.values()) for path in paths]
    found = summary(_contents(reports), _contents(compared), seeds)
    inputs = {str(path): digest(path) for path in files}
    stamp = make_stamp("ablations", work.budget, inputs=inputs)
    write_json(work.out / "ablations.json", {**found, "provenance": stamp.as_json()})
    write_json(work.out / "table.json", report_table(found))
    text = ablation_page(found)
    write_text(work.out / "ablations.md", text)
    return text


def _contents(files: Mapping[str, Sequence[Path]]) -> dict[str, list[Any]]:
    return {key: [read_json(path) for path in paths] for key, paths in files.items()}


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablations")
    parser.add_argument("root", type=Path, help="the benchmark, with labels")
    parser.add_argument("--out", type=Path, default=Path("build/ablations"))
    parser.add_argument("--seeds", default="0", help="seeds of the trainings, as 0,1,2")
    parser.add_argument("--rows", default="", help="keys as no-pift,eq8; needed rows are added")
    for name, default in vars(Budget()).items():
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(option, type=int, default=default, help=f"default {default}")
    return parser.parse_args(arguments)


def seeds_of(text: str) -> list[int]:
    """Return the seeds of `0,1,2`, each once.

    Raises:
        ValueRangeError: `text` has another form.
    """
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() for part in parts):
        raise ValueRangeError("--seeds", repr(text), "numbers as 0,1,2")
    return list(dict.fromkeys(map(int, parts)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the table; return the exit code."""
    options = parsed(arguments)
    budget = Budget(**{name: getattr(options, name) for name in vars(Budget())})
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        seeds = seeds_of(options.seeds)
        if not GraspNetRoot(options.root).scenes():
            raise MissingInputError(options.root / "scenes", "symgrasp synthesize")
        rows = rows_named(options.rows.split(",")) if options.rows else ABLATIONS
        work = Ablations(options.root, options.out, budget, trained_regions, rows)
        sys.stdout.write(make_table(work, seeds, run_symgrasp))
    except SymgraspError as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write(f"stopped; {GOES_ON}\n")
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
