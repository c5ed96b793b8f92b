"""The commands of symgrasp that make Table IV, in order; `benchmarks.ablations` runs them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.ablation_table import ABLATIONS, Row

REFINED, UNREFINED, UNCUT = "refined", "unrefined", "uncut"
FILES = ("models", "scenes", "grasp_label", "objects.json")
SHARED = {REFINED: (), UNREFINED: (*FILES, "symmetry"), UNCUT: FILES}  # shared with the first root
BATCH, DETECTOR_BATCH = 12, 4
DECAYS = 20  # drops of the learning rate by a tenth, to 0.12 of its start value
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
