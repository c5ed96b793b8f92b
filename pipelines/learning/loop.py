"""The training engine that `train` and `finetune-detector` share.

A run owns three things beside its output `NAME.safetensors`: `NAME.checkpoint.safetensors`, from
which it goes on exactly, the folder `NAME.logs` of TensorBoard scalars, and the output itself,
which always holds the best weights by validation so far. All are written whole or not at all.
"""

import json
import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipelines.configs import FinetuneDetectorConfig, TrainConfig
from pipelines.errors import ValueRangeError
from pipelines.formats.checkpoints import (
    TrainingState,
    load_training,
    save_training,
    save_weights,
)
from pipelines.formats.provenance import Stamp
from pipelines.learning.gradients import GradientWorkers, intra_op_threads
from pipelines.learning.loaders import prefetch
from pipelines.learning.runs import Progress, RunRequest, checkpoint_path, log_folder
from pipelines.learning.trainee import Trainee
from pipelines.learning.weight_average import WeightAverage

log = logging.getLogger(__name__)


LearningConfig = TrainConfig | FinetuneDetectorConfig


@dataclass(frozen=True)
class LoopOptions:
    """How long and how fast to train.

    Attributes:
        epochs: passes over the data.
        learning_rate: of Adam, at first.
        decay: factor of the learning rate every `decay_epochs` epochs (Sec. III-G).
        decay_epochs: may be a fraction of an epoch.
        ema_decay: of the running mean of the weights, which is what is validated and kept.
        clip_norm: gradients longer than this are shortened to it.
        seed: of everything drawn at random.
        threads: micro-batches worked on at a time.
        time_limit: minutes after which the run stops cleanly, None for no limit.
        checkpoint_minutes: between checkpoints.
        log_seconds: between log lines.
    """

    epochs: int
    learning_rate: float
    decay: float
    decay_epochs: float
    ema_decay: float = 0.998
    clip_norm: float = 10.0
    seed: int = 0
    threads: int = 1
    time_limit: float | None = None
    checkpoint_minutes: float = 3.0
    log_seconds: float = 20.0

    @classmethod
    def of(cls, config: LearningConfig, request: RunRequest) -> "LoopOptions":
        """Return what the config of a stage says of steps, and the request of this run."""
        return cls(
            epochs=config.epochs,
            learning_rate=config.learning_rate,
            decay=config.decay,
            decay_epochs=config.decay_epochs,
            ema_decay=config.ema_decay,
            seed=request.seed,
            threads=request.threads,
            time_limit=request.time_limit,
        )


class TrainingRun:
    """One training, from its first step or its checkpoint to its end or its time limit."""

    def __init__(
        self,
        trainee: Trainee,
        options: LoopOptions,
        output: Path,
        stamp: Stamp,
        metadata: Mapping[str, str],
    ) -> None:
        self.trainee, self.options, self.output, self.stamp = trainee, options, output, stamp
        self.metadata = dict(metadata)
        self.module = trainee.module
        self.parameters = [p for p in self.module.parameters() if p.requires_grad]
        self.optimizer = torch.optim.Adam(self.parameters, lr=options.learning_rate)
        self.average = WeightAverage(self.module, options.ema_decay)
        self.progress = Progress()
        self._began = self._saved = self._logged = time.monotonic()
        self._losses: dict[str, float] = {}

    def resume(self) -> None:
        """Go back to where the checkpoint stands."""
        state = load_training(checkpoint_path(self.output))
        self.module.load_state_dict(_with_prefix(state.model, "weights."))
        self.average.load(_with_prefix(state.model, "average."))
        self.optimizer.load_state_dict(state.optimizer)
        self.progress = Progress(**state.progress)

    def run(self) -> Progress:
        """Train, validate after each epoch and at the end, and return where it stands."""
        from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - slow to import

        self._steps_before = self.progress.total_steps
        purge = self.progress.total_steps or None
        self.writer = SummaryWriter(str(log_folder(self.output)), purge_step=purge)
        self._began = self._saved = self._logged = time.monotonic()
        threads = self.options.threads if self.trainee.parallel else 1
        with (
            self.writer,
            intra_op_threads(self.options.threads),
            GradientWorkers(self.trainee, threads) as workers,
        ):
            while self.progress.epoch < self.options.epochs and not self._out_of_time():
                self._run_epoch(workers)
        self.progress.finished = self.progress.epoch >= self.options.epochs
        self._save_checkpoint()
        return self.progress

    def _run_epoch(self, workers: GradientWorkers) -> None:
        epoch, seed = self.progress.epoch, self.options.seed
        batches = self.trainee.epoch(np.random.default_rng((seed, epoch)))
        if not len(batches):
            raise ValueRangeError("number of batches an epoch", 0, "at least 1")
        remaining = range(self.progress.step, len(batches))
        self.module.train()

        def load(step: int) -> Sequence[tuple[float, Any]]:
            return self.trainee.load(batches[step], np.random.default_rng((seed, epoch, step)))

        loaded = prefetch(load, remaining)
        for step, micro_batches in zip(remaining, loaded, strict=True):
            self._set_learning_rate(epoch + step / len(batches))
            self._step(workers, micro_batches)
            self.progress.step = step + 1
            self._report_and_save(len(batches))
            if self._out_of_time():
                break
        loaded.close()  # type: ignore[attr-defined]  # a generator: stops its thread
        if self.progress.step == len(batches):
            self.progress.epoch, self.progress.step = epoch + 1, 0
        self._validate()
        self._save_checkpoint()

    def _step(self, workers: GradientWorkers, micro_batches: Sequence[tuple[float, Any]]) -> None:
        key = (self.options.seed, self.progress.epoch, self.progress.step)
        losses, gradients = workers.gradients(micro_batches, key)
        if not all(math.isfinite(value) for value in losses.values()):
            raise ValueRangeError(
                f"loss at epoch {key[1] + 1}, step {key[2] + 1}",
                losses,
                f"finite; lower the learning rate, or resume from {checkpoint_path(self.output)}",
            )
        for parameter, gradient in zip(self.parameters, gradients, strict=True):
            parameter.grad = gradient
        torch.nn.utils.clip_grad_norm_(self.parameters, self.options.clip_norm)
        self.optimizer.step()
        self.progress.total_steps += 1
        self.average.update(self.progress.total_steps)
        for name, value in losses.items():  # a running mean, for the log
            self._losses[name] = 0.95 * self._losses.get(name, value) + 0.05 * value

    def _set_learning_rate(self, epochs_done: float) -> None:
        drops = math.floor(epochs_done / self.options.decay_epochs + 1e-9)
        for group in self.optimizer.param_groups:
            group["lr"] = self.options.learning_rate * self.options.decay**drops

    def _validate(self) -> None:
        trainee, progress = self.trainee, self.progress
        with self.average.applied():
            self.module.eval()
            figures = trainee.validate()
            self.module.train()
            value = figures[trainee.best_by]
            sign = 1.0 if trainee.higher_is_better else -1.0
            better = progress.best is None or sign * value > sign * progress.best
            if better and math.isfinite(value):
                progress.best, progress.figures = value, figures
                self._save_weights()
        for name, figure in figures.items():
            self.writer.add_scalar(f"val/{name}", figure, progress.total_steps)
        text = ", ".join(f"{name} {figure:.4g}" for name, figure in figures.items())
        log.info("validation after %d steps: %s", progress.total_steps, text)

    def _report_and_save(self, steps_an_epoch: int) -> None:
        now, progress = time.monotonic(), self.progress
        if now - self._logged > self.options.log_seconds:
            self._logged = now
            for name, value in self._losses.items():
                self.writer.add_scalar(f"train/{name}", value, progress.total_steps)
            log.info(
                "epoch %d/%d, step %d/%d, %s, %s left",
                progress.epoch + 1,
                self.options.epochs,
                progress.step,
                steps_an_epoch,
                ", ".join(f"{name} {value:.3f}" for name, value in self._losses.items()),
                self._time_left(steps_an_epoch),
            )
        if now - self._saved > 60.0 * self.options.checkpoint_minutes:
            self._save_checkpoint()

    def _time_left(self, steps_an_epoch: int) -> str:
        done = self.progress.total_steps - self._steps_before
        total = self.options.epochs * steps_an_epoch - self._steps_before
        seconds = self._elapsed() / done * (total - done)
        if self.options.time_limit is not None:
            seconds = min(seconds, 60.0 * self.options.time_limit - self._elapsed())
        minutes, seconds = divmod(round(max(seconds, 0.0)), 60)
        return f"{minutes}:{seconds:02d}"

    def _save_weights(self) -> None:
        metadata = self.metadata | {"validation": json.dumps(self.progress.figures, sort_keys=True)}
        save_weights(self.output, self.module.state_dict(), metadata, self.stamp)

    def _save_checkpoint(self) -> None:
        now = time.monotonic()
        self.progress.seconds += now - self._saved
        self._saved = now
        model = {f"weights.{name}": each for name, each in self.module.state_dict().items()}
        model |= {f"average.{name}": each for name, each in self.average.state().items()}
        state = TrainingState(model, self.optimizer.state_dict(), dict(vars(self.progress)))
        save_training(checkpoint_path(self.output), state, self.stamp)

    def _elapsed(self) -> float:
        return time.monotonic() - self._began

    def _out_of_time(self) -> bool:
        limit = self.options.time_limit
        return limit is not None and self._elapsed() > 60.0 * limit


def _with_prefix(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {n.removeprefix(prefix): tensor for n, tensor in tensors.items() if n.startswith(prefix)}
