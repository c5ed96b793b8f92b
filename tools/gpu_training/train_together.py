"""Train several networks on one GPU at the same time, in one process: rows and seeds of Table IV.

A step of a network is thousands of short kernels that leave most of a GPU idle, so the steps of
different networks run at the same time, each in its own stream. A row with weights in the output
folder continues from these. Several values of `--minutes` and `--max-steps` give successive
trainings; each begins with the weights of the previous training and the full learning rate.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch

from pipelines.configs import TrainConfig
from pipelines.configs.presets import PRESETS
from pipelines.errors import errors_as_sentences
from pipelines.learning.grasp_network.grasp_training import Sample
from pipelines.learning.loop.loop import LOG_SECONDS
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import load_weights, save_weights
from pipelines.train import build
from tools.gpu_training.rendering import RegionRing, Renderers
from tools.gpu_training.schedule import Schedule
from tools.gpu_training.train import (
    FIRST_REGIONS,
    GraphStep,
    drawn_sample,
    first_regions,
    prepare_layers,
    train_config,
)

SEEDS_APART = 1000  # offset, so that a continued run draws other regions
DROPS = 20  # drops of the learning rate, by a tenth each (Sec. III-G)


class RowPlan(NamedTuple):
    """A row of the table before its first step: its name, objects and settings."""

    name: str
    objects: Path
    config: TrainConfig

    @classmethod
    def of(cls, text: str, objects: Path, preset: str | None) -> "RowPlan":
        """Return the row of NAME[@OBJECTS][:SETTING=VALUE,...]."""
        head, _, settings = text.partition(":")
        name, _, own = head.partition("@")
        chosen = [each for each in settings.split(",") if each]
        return cls(name, Path(own) if own else objects, train_config(preset, chosen))


@dataclass(frozen=True)
class RenderedRegions:
    """Regions of one file of objects: a ring on the device, and the processes that render more."""

    ring: RegionRing
    renderers: Renderers


@dataclass(frozen=True)
class TrainedRow:
    """One row of the table with one seed, in its own stream.

    Attributes:
        name: name of the row and of its file.
        objects: file of the training objects.
        seed: seed of the first weights and of the training regions.
        config: settings of the training.
        step: the network and its training step.
        stream: CUDA stream of the row; None on the CPU.
        earlier: number of steps of earlier runs.
    """

    name: str
    objects: Path
    seed: int
    config: TrainConfig
    step: GraphStep
    stream: torch.cuda.Stream | None
    earlier: int

    @classmethod
    def of(
        cls, plan: RowPlan, seed: int, ring: RegionRing, options: argparse.Namespace
    ) -> "TrainedRow":
        """Return a row with new weights, or with the weights of an earlier run.

        Raises:
            FormatError: these are of a network with other settings, as `build` says.
        """
        name, objects, config = plan
        path = weights_path(options.out, name, seed)
        earlier = earlier_steps(path)
        drawn = seed + SEEDS_APART * earlier
        torch.manual_seed(drawn)
        first = drawn_sample(ring, config.batch_size, config)
        device = first.query.device
        module = build(config, drawn, path if path.exists() else None).to(device).train()
        step = GraphStep(module, first, config, config.learning_rate, as_graph=options.graph)
        stream = torch.cuda.Stream() if device.type == "cuda" else None
        return cls(name, objects, seed, config, step, stream, earlier)

    def learn(self, sample: Sample, rate: float) -> None:
        """Make a step after all earlier work of the GPU."""
        if self.stream is not None:
            self.stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self.stream):
            self.step.run(sample, rate, averaged=0.0)

    def wait(self) -> None:
        """Make later work of the GPU wait for this row's step."""
        if self.stream is not None:
            torch.cuda.current_stream().wait_stream(self.stream)

    def write(self, folder: Path, steps: int) -> None:
        """Write the weights after `steps` steps."""
        metadata = weights_metadata(SymmetryGraspNet.__name__, self.config.network)
        metadata |= {"steps": str(self.earlier + steps), "seed": str(self.seed)}
        metadata |= {"batch_size": str(self.config.batch_size)}
        path = weights_path(folder, self.name, self.seed)
        save_weights(path, self.step.averaged_weights(), metadata)


def weights_path(folder: Path, name: str, seed: int) -> Path:
    """Return the path of a row's weights."""
    return folder / f"{name}_{seed}.safetensors"


def earlier_steps(path: Path) -> int:
    """Return the number of steps of the weights at `path`; 0 without a file."""
    return int(load_weights(path)[1].get("steps", 0)) if path.exists() else 0


def scene_seed(first: RowPlan, options: argparse.Namespace) -> int:
    """Return the seed of the scenes, another one after each run that `first` continues."""
    seed: int = options.seeds[0]
    return seed + SEEDS_APART * earlier_steps(weights_path(options.out, first.name, seed))


def run_rounds(
    rows: Sequence[TrainedRow],
    sources: Mapping[Path, RenderedRegions],
    seconds: float,
    max_steps: int,
) -> Iterator[int]:
    """Make steps of all rows in turn; yield the number of steps.

    Ends after `seconds` or `max_steps`. Rows with the same seed, file of objects and settings of
    samples learn from the same samples.
    """
    began, steps = time.monotonic(), 0
    while (now := time.monotonic() - began) < seconds and steps < max_steps:
        if steps % 4 == 0:
            for source in sources.values():
                source.ring.take_in(source.renderers, 4)
        samples: dict[str, Sample] = {}
        for row in rows:
            key = sample_key(row)
            if key not in samples:
                ring = sources[row.objects].ring
                samples[key] = drawn_sample(ring, row.config.batch_size, row.config)
        for row in rows:
            schedule = Schedule(row.config.learning_rate, seconds, 0.0, DROPS, max_steps)
            row.learn(samples[sample_key(row)], schedule.rate_at(steps, now))
        for row in rows:
            row.wait()
        steps += 1
        yield steps


def sample_key(row: TrainedRow) -> str:
    """Return a text that is equal for rows that may learn from the same samples."""
    config, network = row.config, row.config.network
    drawn = config.augmentation, config.batch_size, config.num_loss_points
    return repr((row.objects, row.seed, drawn, network.input_frame, network.num_points))


def train_rows(options: argparse.Namespace) -> None:
    """Train all rows with all seeds, once for each time limit in `options`."""
    device = torch.device(options.device)
    plans = [RowPlan.of(text, options.objects, options.preset) for text in options.row]
    files = dict.fromkeys(plan.objects for plan in plans)
    workers = max(1, options.workers // len(files))
    seed = scene_seed(plans[0], options)
    renderers = {path: Renderers(path, seed, workers, options.limit) for path in files}
    prepare_layers(device)
    capacity, first = options.capacity, options.first_regions
    sources = {
        path: RenderedRegions(first_regions(each, capacity, device, first), each)
        for path, each in renderers.items()
    }
    options.out.mkdir(parents=True, exist_ok=True)
    limits = options.max_steps or [10**9] * len(options.minutes)
    for minutes, most in zip(options.minutes, limits, strict=True):
        rows = [
            TrainedRow.of(plan, seed, sources[plan.objects].ring, options)
            for plan in plans
            for seed in options.seeds
        ]
        train_once(rows, sources, minutes, most, options)
    for each in renderers.values():
        each.end()


def train_once(
    rows: Sequence[TrainedRow],
    sources: Mapping[Path, RenderedRegions],
    minutes: float,
    max_steps: int,
    options: argparse.Namespace,
) -> None:
    """Train the rows; write the weights at intervals and at the end."""
    steps, reported, written = 0, time.monotonic(), time.monotonic()
    for steps in run_rounds(rows, sources, 60.0 * minutes, max_steps):
        now = time.monotonic()
        if now - reported > LOG_SECONDS:
            reported = now
            losses = {f"{row.name}_{row.seed}": round(float(row.step.loss), 3) for row in rows}
            seen = [source.ring.seen for source in sources.values()]
            line = json.dumps({"steps": steps, "regions": seen, "loss": losses})
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
        if now - written > 60.0 * options.write_minutes:
            written = now
            for row in rows:
                row.write(options.out, steps)
    for row in rows:
        row.write(options.out, steps)


@errors_as_sentences()
def main() -> None:
    """Read the options and train."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=Path, required=True, help="written by labelled_objects")
    parser.add_argument("--out", type=Path, required=True, help="folder of the weights")
    parser.add_argument(
        "--row", action="append", required=True, help="NAME[@OBJECTS][:SETTING=VALUE,...]"
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="seeds of each row")
    parser.add_argument("--preset", choices=PRESETS, help="settings of `symgrasp train --preset`")
    parser.add_argument(
        "--minutes", type=float, nargs="+", default=[9.0], help="after the first regions"
    )
    parser.add_argument("--write-minutes", type=float, default=1.0, help="minutes between writes")
    parser.add_argument("--max-steps", type=int, nargs="+", help="one value for each of --minutes")
    parser.add_argument("--graph", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--workers", type=int, default=15, help="processes that render")
    parser.add_argument("--limit", type=int, help="number of first objects to use")
    parser.add_argument(
        "--first-regions",
        type=int,
        default=FIRST_REGIONS,
        help="regions before the first step, at most half of --capacity",
    )
    parser.add_argument("--capacity", type=int, default=150_000, help="regions on the device")
    parser.add_argument("--device", default="cuda")
    options = parser.parse_args()
    if options.max_steps and len(options.max_steps) != len(options.minutes):
        parser.error("--max-steps needs one value for each of --minutes")
    train_rows(options)


if __name__ == "__main__":
    main()
