"""Table IV: the method with one part left out at a time: `python -m benchmarks.ablations ROOT`.

Makes a training set, trains two detectors and, for each row and seed, a network, infers and
evaluates on ROOT, the benchmark of `make eval`, and writes OUT/ablations.json, OUT/table.json (for
`evaluate --table`) and OUT/ablations.md again after each row has all its seeds. Commands of
`symgrasp` do all the work. Finished steps are not repeated: each step leaves a record of its
command and its defaults, and an interrupted step resumes as its command does.
"""

import argparse
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.ablation_steps import Ablations, Budget, Step
from benchmarks.ablation_table import (
    ABLATIONS,
    Row,
    ablation_page,
    report_table,
    rows_named,
    summary,
)
from pipelines.configs.stages import default_settings
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import MissingInputError, SymgraspError, ValueRangeError
from pipelines.inference import models
from pipelines.storage.files import read_json, write_json, write_text
from pipelines.storage.provenance import digest, make_stamp
from pipelines.storage.weights_manifest import manifest_path

SYMGRASP = (sys.executable, "-c", "from symgrasp_cli.main import main; main()")
GOES_ON = "the same command continues from there"
Run = Callable[[Sequence[str]], None]


def perform(steps: Iterator[Step], records: Path, run: Run) -> None:
    """Run the steps without a record, without their output, or with other defaults by now.

    A command with other defaults refuses its earlier output, unless its stamp is still the same.

    Raises:
        SymgraspError: the record of a step has another command, or a command failed.
    """
    for step in steps:
        record, defaults = records / f"{step.name}.json", defaults_of(step.command[0])
        if record.is_file():
            found = read_json(record)
            if found.get("command") != list(step.command):
                raise SymgraspError(
                    f"{record} has another command than `symgrasp {shlex.join(step.command)}`; "
                    f"give the same budget, or name another --out than {records.parent}"
                )
            if step.output.exists() and found.get("defaults") == defaults:
                continue
        sys.stderr.write(f"== symgrasp {shlex.join(step.command)}\n")
        started, busy = time.monotonic(), cpu_seconds()
        run(step.command)
        seconds, cpu = time.monotonic() - started, cpu_seconds() - busy
        taken = {"seconds": round(seconds, 1), "cpu_seconds": round(cpu, 1)}
        write_json(record, {"command": list(step.command), "defaults": defaults, **taken})


def defaults_of(stage: str) -> str:
    """Return a digest of a command's default settings and of the default weights."""
    inputs = {"weights": digest(manifest_path(models.WEIGHTS))}
    return make_stamp(stage, default_settings(stage), inputs=inputs).as_digest()


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
