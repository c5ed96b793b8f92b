"""Train several networks on one GPU at a time, in one process: the rows and seeds of Table IV.

A step of a network is thousands of short kernels that leave most of a GPU idle, so the steps of
different networks run at the same time, each in a stream of its own. A row whose weights lie in the
output folder goes on from them.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from pipelines.configs import TrainConfig
from pipelines.configs.presets import PRESETS
from pipelines.learning.grasp_network.grasp_training import Sample
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import load_weights, save_weights
from tools.gpu_training.rendering import RegionRing, Renderers
from tools.gpu_training.schedule import LOG_SECONDS, Schedule
from tools.gpu_training.train import (
    GraphStep,
    drawn_sample,
    first_regions,
    prepare_layers,
    train_config,
)

SEEDS_APART = 1000  # a run that goes on draws other regions
DROPS = 20  # of the learning rate, by a tenth each (Sec. III-G)


@dataclass(frozen=True)
class TrainedRow:
    """One row of the table with one seed, in a stream of its own.

    Attributes:
        name: of its file.
        seed: of its first weights and of what it learns from.
        config: of its training.
        step: its network and how it learns.
        stream: that it runs in; None on the CPU.
        earlier: steps that an earlier run made.
    """

    name: str
    seed: int
    config: TrainConfig
    step: GraphStep
    stream: torch.cuda.Stream | None
    earlier: int

    @classmethod
    def of(
        cls,
        name: str,
        seed: int,
        config: TrainConfig,
        ring: RegionRing,
        options: argparse.Namespace,
    ) -> "TrainedRow":
        """Return a row that has learned nothing yet, or what its weights hold."""
        path = weights_path(options.out, name, seed)
        weights, metadata = load_weights(path) if path.exists() else ({}, {})
        earlier = int(metadata.get("steps", 0))
        torch.manual_seed(seed + SEEDS_APART * earlier)
        first = drawn_sample(ring, config.batch_size, config)
        device = first.query.device
        module = SymmetryGraspNet(config.network).to(device).train()
        if weights:
            module.load_state_dict(weights)
        step = GraphStep(module, first, config, config.learning_rate, as_graph=options.graph)
        stream = torch.cuda.Stream() if device.type == "cuda" else None
        return cls(name, seed, config, step, stream, earlier)

    def learn(self, sample: Sample, rate: float) -> None:
        """Make a step once all that was asked of the GPU before is done."""
        if self.stream is not None:
            self.stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self.stream):
            self.step.run(sample, rate, averaged=0.0)

    def wait(self) -> None:
        """Let what is asked of the GPU from now on be done after this row's step."""
        if self.stream is not None:
            torch.cuda.current_stream().wait_stream(self.stream)

    def write(self, folder: Path, steps: int) -> None:
        """Write the weights after so many steps."""
        metadata = weights_metadata(SymmetryGraspNet.__name__, self.config.network)
        metadata |= {"steps": str(self.earlier + steps), "seed": str(self.seed)}
        metadata |= {"batch_size": str(self.config.batch_size)}
        path = weights_path(folder, self.name, self.seed)
        save_weights(path, self.step.averaged_weights(), metadata)


def weights_path(folder: Path, name: str, seed: int) -> Path:
    """Return where a row's weights lie."""
    return folder / f"{name}_{seed}.safetensors"


def run_rounds(
    rows: Sequence[TrainedRow], ring: RegionRing, renderers: Renderers, seconds: float
) -> Iterator[int]:
    """Let each row make one step after the other, until `seconds` are over; yield their number.

    Rows of one seed that draw regions alike learn from the same samples.
    """
    began, steps = time.monotonic(), 0
    while (now := time.monotonic() - began) < seconds:
        if steps % 4 == 0:
            ring.take_in(renderers, 4)
        samples: dict[str, Sample] = {}
        for row in rows:
            key = sample_key(row)
            if key not in samples:
                samples[key] = drawn_sample(ring, row.config.batch_size, row.config)
        for row in rows:
            schedule = Schedule(row.config.learning_rate, seconds, 0.0, DROPS)
            row.learn(samples[sample_key(row)], schedule.rate_at(steps, now))
        for row in rows:
            row.wait()
        steps += 1
        yield steps


def sample_key(row: TrainedRow) -> str:
    """Return a text that is the same for rows that may learn from the same samples."""
    config, network = row.config, row.config.network
    drawn = config.augmentation, config.batch_size, config.num_loss_points
    return repr((row.seed, drawn, network.input_frame, network.num_points))


def train_rows(options: argparse.Namespace) -> None:
    """Train all rows with all seeds; write the weights now and then, and at the end."""
    device = torch.device(options.device)
    named = [text.partition(":") for text in options.row]
    configs = {name: train_config(options.preset, _split(rest)) for name, _, rest in named}
    renderers = Renderers(options.objects, options.seeds[0], options.workers, options.limit)
    prepare_layers(device)
    ring = first_regions(renderers, options.capacity, device)
    rows = [
        TrainedRow.of(name, seed, config, ring, options)
        for name, config in configs.items()
        for seed in options.seeds
    ]
    options.out.mkdir(parents=True, exist_ok=True)
    steps, told, written = 0, time.monotonic(), time.monotonic()
    for steps in run_rounds(rows, ring, renderers, 60.0 * options.minutes):
        now = time.monotonic()
        if now - told > LOG_SECONDS:
            told = now
            losses = {f"{row.name}_{row.seed}": round(float(row.step.loss), 3) for row in rows}
            line = json.dumps({"steps": steps, "regions": ring.seen, "loss": losses})
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
        if now - written > 60.0 * options.write_minutes:
            written = now
            for row in rows:
                row.write(options.out, steps)
        if steps == options.max_steps:
            break
    renderers.end()
    for row in rows:
        row.write(options.out, steps)


def _split(settings: str) -> list[str]:
    return [each for each in settings.split(",") if each]


def main() -> None:
    """Read the options and train."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=Path, required=True, help="written by labelled_objects")
    parser.add_argument("--out", type=Path, required=True, help="folder of the weights")
    parser.add_argument("--row", action="append", required=True, help="NAME[:SETTING=VALUE,...]")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="of each row")
    parser.add_argument("--preset", choices=PRESETS, help="settings of `symgrasp train --preset`")
    parser.add_argument("--minutes", type=float, default=9.0, help="after the first regions")
    parser.add_argument("--write-minutes", type=float, default=1.0, help="between two writings")
    parser.add_argument("--max-steps", type=int, default=10**9)
    parser.add_argument("--graph", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--workers", type=int, default=15, help="processes that render")
    parser.add_argument("--limit", type=int, help="objects to use, the first ones")
    parser.add_argument("--capacity", type=int, default=150_000, help="regions on the device")
    parser.add_argument("--device", default="cuda")
    train_rows(parser.parse_args())


if __name__ == "__main__":
    main()
