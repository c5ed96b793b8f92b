"""Train the region detector on one GPU; the host's cores prepare random views."""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset, get_worker_info
from torchvision.models.detection import MaskRCNN

from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.errors import errors_as_sentences
from pipelines.learning.detector.detector_start import starting_detector
from pipelines.learning.detector.detector_training import frames_loss
from pipelines.learning.detector.frame_views import DetectorExample, random_example
from pipelines.learning.loop.loop import CLIP_NORM, LOG_SECONDS
from pipelines.learning.speed.weight_average import WeightAverage
from pipelines.network.detection.detector import MODEL_NAME
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import save_weights
from tools.gpu_training.schedule import Schedule
from tools.gpu_training.small_frames import SmallFrames, count_small_frames

SAVE_SECONDS = 60.0
LOOK_STEPS = 20  # steps between reads of the losses


class RandomViews(IterableDataset[DetectorExample]):
    """Random views of the frames of files, without end."""

    def __init__(self, files: list[Path], kind: str, seed: int) -> None:
        self.files, self.kind, self.seed = files, kind, seed

    def __iter__(self) -> Iterator[DetectorExample]:
        cv2.setNumThreads(1)
        info = get_worker_info()
        rng = np.random.default_rng([self.seed, info.id if info else 0])
        sets = [SmallFrames(file) for file in self.files]
        ends = np.cumsum([len(each) for each in sets])
        while True:
            number = int(rng.integers(ends[-1]))
            which = int(np.searchsorted(ends, number, side="right"))
            first = int(ends[which - 1]) if which else 0
            yield random_example(sets[which][number - first], self.kind, rng)


@dataclass
class DetectorRun:
    """A detector, its optimizer and the mean of its weights."""

    detector: MaskRCNN
    config: FinetuneDetectorConfig
    device: torch.device
    schedule: Schedule
    seed: int = 0
    steps: int = 0
    losses: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.detector.to(self.device, memory_format=torch.channels_last).train()
        self.parameters = list(self.detector.parameters())
        self.optimizer = torch.optim.Adam(self.parameters, lr=self.schedule.rate)
        self.average = WeightAverage(self.detector, self.schedule.averaged)
        self.generator = torch.Generator().manual_seed(self.seed)

    def step(self, batch: list[DetectorExample], seconds: float) -> None:
        """Learn from `batch`, `seconds` after the start."""
        self.steps += 1
        for group in self.optimizer.param_groups:
            group["lr"] = self.schedule.rate_at(self.steps, seconds)
        self.optimizer.zero_grad()
        terms = frames_loss(self.detector, batch, self.generator, self.device)
        terms["total"].backward()
        norm = torch.nn.utils.clip_grad_norm_(self.parameters, CLIP_NORM)
        if torch.isfinite(norm):
            self.optimizer.step()
            self.average.update(self.steps)
        if self.steps % LOOK_STEPS == 0:  # to read a number waits for the device
            for name, term in terms.items():
                value = float(term.detach())
                self.losses[name] = 0.8 * self.losses.get(name, value) + 0.2 * value

    def save(self, path: Path) -> None:
        """Write the mean of the weights."""
        with self.average.applied():
            state = {n: each.detach().cpu() for n, each in self.detector.state_dict().items()}
        metadata = weights_metadata(MODEL_NAME, self.config.detector)
        save_weights(path, state, metadata | {"steps": str(self.steps)})


def train_detector(options: argparse.Namespace) -> None:
    """Train until the minutes are over, and write the mean of the weights."""
    began = time.monotonic()
    for file in options.frames:  # before processes read them, whose errors are no sentences
        count_small_frames(file)
    config = replace(FinetuneDetectorConfig(), detector=DetectorConfig(input=options.input))
    detector = starting_detector(config, options.seed, init=options.init)
    torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = True
    loader = DataLoader(
        RandomViews(options.frames, options.input, options.seed),
        options.batch_size,
        num_workers=options.workers,
        collate_fn=list,
        prefetch_factor=4 if options.workers else None,
    )
    started, end = time.monotonic(), began + 60.0 * options.minutes
    schedule = Schedule(options.rate, end - started, options.averaged)
    run = DetectorRun(detector, config, torch.device(options.device), schedule, options.seed)
    reported = saved = started
    for batch in loader:
        now = time.monotonic()
        run.step(batch, now - started)
        done = now > end or run.steps >= options.max_steps
        if now - reported > LOG_SECONDS or done:
            reported = now
            losses = ", ".join(f"{n} {value:.3f}" for n, value in run.losses.items())
            sys.stdout.write(f"step {run.steps}, {now - began:.0f} s, {losses}\n")
            sys.stdout.flush()
        if now - saved > SAVE_SECONDS or done:
            saved = now
            run.save(options.out)
        if done:
            return


@errors_as_sentences()
def main() -> None:
    """Read the options and train."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--frames", type=Path, nargs="+", required=True, help="written by small_frames"
    )
    parser.add_argument("--out", type=Path, required=True, help="weights to write")
    parser.add_argument("--init", type=Path, help="weights to start from")
    parser.add_argument("--input", default="both", choices=("geometry", "color", "both"))
    parser.add_argument("--minutes", type=float, default=9.0)
    parser.add_argument("--max-steps", type=int, default=10**9)
    parser.add_argument("--batch-size", type=int, default=16)
    parser.add_argument("--rate", type=float, default=0.001, help="largest learning rate")
    parser.add_argument(
        "--averaged", type=float, default=0.998, help="share of the mean kept per step"
    )
    parser.add_argument("--workers", type=int, default=14, help="processes that draw views")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda")
    train_detector(parser.parse_args())


if __name__ == "__main__":
    main()
