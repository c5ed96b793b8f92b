"""The training engine of all trainings.

The output `NAME.safetensors` always holds the best weights by validation so far. A run also owns
`NAME.checkpoint.safetensors`, from which it resumes exactly, `NAME.curves.png`, the folder
`NAME.logs` of TensorBoard scalars, and, after a loss that is not finite, `NAME.fault.safetensors`.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import torch

from pipelines.configs import (
    FinetuneDetectorConfig,
    TrainBaselineConfig,
    TrainConfig,
    TrainCriticConfig,
)
from pipelines.ending import set_farewell
from pipelines.errors import ValueRangeError, counted
from pipelines.learning.loop.faults import describe_losses, save_fault
from pipelines.learning.loop.loaders import load_ahead
from pipelines.learning.loop.run_files import RunFiles
from pipelines.learning.loop.runs import (
    CHECKPOINT,
    FAULT,
    LOGS,
    Progress,
    RunRequest,
    describe,
    file_of_run,
)
from pipelines.learning.loop.trainee import Items, Trainee
from pipelines.learning.progress.display import Display
from pipelines.learning.progress.scalars import Scalars
from pipelines.learning.speed.gradients import (
    GradientWorkers,
    Loaded,
    Losses,
    StepAbandoned,
    intra_op_threads,
)
from pipelines.learning.speed.micro_batches import generator, micro_batches_of
from pipelines.learning.speed.processes import Processes
from pipelines.learning.speed.weight_average import WeightAverage
from pipelines.runtime.batch import StageReport
from pipelines.runtime.stopping import StopReason, StopSignals, TrainingStopped
from pipelines.storage.provenance import Stamp

LearningConfig = TrainConfig | FinetuneDetectorConfig | TrainCriticConfig | TrainBaselineConfig
CLIP_NORM = 10.0  # longest gradient; longer ones are scaled to this norm
CHECKPOINT_SECONDS = 180.0  # between checkpoints
LOG_SECONDS = 20.0  # between log lines


class TrainingRun:
    """One training, from its first step or its checkpoint to its end or its time limit."""

    def __init__(
        self,
        trainee: Trainee,
        config: LearningConfig,
        request: RunRequest,
        output: Path,
        stamp: Stamp,
        metadata: Mapping[str, str],
        processes: Processes | None = None,
    ) -> None:
        self.trainee, self.config, self.request = trainee, config, request
        self.output, self.stamp = output, stamp
        self.processes = processes or Processes()
        self.module = trainee.module
        self.parameters = [p for p in self.module.parameters() if p.requires_grad]
        self.optimizer = torch.optim.Adam(self.parameters, lr=config.learning_rate)
        self.average = WeightAverage(self.module, config.ema_decay)
        self.files = RunFiles(trainee, self.optimizer, self.average, output, stamp, metadata)
        self.progress = Progress()
        self.signals = StopSignals()
        self._losses: Losses = {}
        self._limit = math.inf if request.max_seconds is None else request.max_seconds

    def resume(self) -> None:
        """Restore the state of the checkpoint; with --overwrite, a damaged one is left out."""
        self.progress = self.files.restore(or_anew=self.request.overwrite)

    def report(self, started: float, *, resumes: bool) -> StageReport:
        """Train, from the checkpoint if it `resumes`; return the report of the stage.

        `started`: start of the stage on the monotonic clock.
        """
        if resumes:
            self.resume()
        name, note = self.output.name, describe(self.run())
        seconds = time.monotonic() - started
        return StageReport(self.stamp.stage, [name], notes={name: note}, seconds=seconds)

    def run(self) -> Progress:
        """Train, validate after each epoch and at the end, and return the progress.

        Raises:
            TrainingStopped: SIGTERM or Ctrl-C came; a checkpoint is written.
            ValueRangeError: the loss or its gradient is not finite; the batch is kept.
            SymgraspError: the figure of every validation was not finite; there are no weights.
        """
        self.processes.wait()  # no process writes before all have read
        self._steps_before = self.progress.total_steps
        self._began = self.files.saved = self._logged = time.monotonic()
        with ExitStack() as stack:
            stack.enter_context(self.signals.recorded(expects_repeats=self.processes.count > 1))
            with self.signals.ending_at_once():  # before the first step nothing is lost
                self.scalars = self._new_scalars()
            self.display = stack.enter_context(self._make_display())
            stack.enter_context(intra_op_threads(self.request.threads))
            workers = stack.enter_context(self._make_workers())
            reason, is_saved = self._why_stop(), False
            while self.progress.epoch < self.config.epochs and not reason:
                reason, is_saved = self._run_epoch(workers), True
        self.progress.finished = self.progress.epoch >= self.config.epochs
        if self.progress.finished and self.processes.is_first:
            self.files.finish(self.progress)
        if self.progress.finished or not is_saved:
            self._save_checkpoint()
        if self.progress.finished and self.processes.is_first:
            self.files.refuse_no_weights(self.progress)
        if reason > StopReason.TIME_LIMIT and not self.progress.finished:
            raise TrainingStopped(
                reason,
                f"after {counted(self.progress.total_steps, 'step')}; "
                f"{file_of_run(self.output, CHECKPOINT)} holds the training, --resume continues",
            )
        return self.progress

    def _new_scalars(self) -> Scalars | None:
        if not self.processes.is_first:
            return None
        # Hides an earlier run's scalars of later steps, or all scalars if this run starts anew.
        return Scalars(file_of_run(self.output, LOGS), self.progress.total_steps + 1)

    def _make_display(self) -> Display:
        shown, bar = self.processes.is_first, self.request.progress
        return Display(shown=shown, bar=bar, seconds=LOG_SECONDS)

    def _make_workers(self) -> GradientWorkers:
        threads = self.request.threads if self.trainee.parallel else 1
        return GradientWorkers(self.trainee, threads, self.processes, self._stop_alone())

    def _run_epoch(self, workers: GradientWorkers) -> StopReason:
        """Take the remaining steps of an epoch and save; return the reason to stop, if any."""
        epoch, seed = self.progress.epoch, self.request.seed
        batches = self.trainee.epoch(epoch, generator(seed, epoch))
        if not len(batches):
            raise ValueRangeError("number of batches per epoch", 0, "at least 1")
        remaining = range(self.progress.step, len(batches))
        self.module.train()

        def load(step: int) -> list[Loaded]:
            planned = micro_batches_of(batches[step], self.trainee.micro_batch_size, self.processes)
            return [(each, each.load(self.trainee, seed, epoch, step)) for each in planned]

        reason = StopReason.NONE
        loaded = load_ahead(load, remaining, self.request.loaders, self._stop_alone())
        for step, micro_batches in zip(remaining, loaded, strict=False):  # fewer if the run stops
            self._set_learning_rate(epoch + step / self._steps_an_epoch(batches))
            try:
                self._step(workers, micro_batches)
            except StepAbandoned:
                reason = self._why_stop()
                break
            self.progress.step = step + 1
            self._report_and_save(batches)
            if reason := self._why_stop():
                break
        loaded.close()  # stops loading
        if self.progress.step < len(batches) and not reason:
            reason = self._why_stop()
        self._save_checkpoint()
        whole_epoch = self.progress.step >= len(batches)
        if reason <= StopReason.TIME_LIMIT and (whole_epoch or reason is StopReason.TIME_LIMIT):
            self._validate(whole_epoch=whole_epoch)
            self._save_checkpoint()
        return reason

    def _step(self, workers: GradientWorkers, loaded: Sequence[Loaded]) -> None:
        place = (self.request.seed, self.progress.epoch, self.progress.step)
        losses, gradients = workers.gradients(loaded, place)
        for parameter, gradient in zip(self.parameters, gradients, strict=True):
            parameter.grad = gradient
        norm = float(torch.nn.utils.clip_grad_norm_(self.parameters, CLIP_NORM))
        if not all(math.isfinite(value) for value in (norm, *losses.values())):
            self._give_up(workers, loaded, losses | {"gradient": norm})
        workers.adopt_buffers()
        self.optimizer.step()
        self.progress.total_steps += 1
        self.average.update(self.progress.total_steps)
        self.progress.history.add_losses(losses)
        for name, value in losses.items():  # a running mean, for the log
            self._losses[name] = 0.95 * self._losses.get(name, value) + 0.05 * value

    def _give_up(self, workers: GradientWorkers, loaded: Sequence[Loaded], losses: Losses) -> None:
        """Keep the faulty micro-batch and raise an error that names its file."""
        place = (self.request.seed, self.progress.epoch, self.progress.step)
        fault, path = workers.find_fault(loaded, place), file_of_run(self.output, FAULT)
        number = fault[0].number if fault else -1
        last = self.processes.most(number)  # only one process with a fault keeps it
        if fault is not None and number == last:
            batch = self.trainee.tensors(fault[1])
            save_fault(path, self.module, batch, (*place, number), self.stamp)
        self.processes.wait()
        kept = (
            f"{path} holds the batch" if last >= 0 else "each micro-batch alone has a finite loss"
        )
        raise ValueRangeError(
            f"loss at epoch {place[1] + 1}, step {place[2] + 1}",
            describe_losses(losses),
            f"finite; {kept}; a lower learning rate may help",
        )

    def _steps_an_epoch(self, batches: Sequence[Items]) -> int:
        """Return the steps of a whole epoch; the last one of a compared method may be shorter."""
        config = self.config
        return config.epoch_steps if isinstance(config, TrainBaselineConfig) else len(batches)

    def _set_learning_rate(self, epochs_done: float) -> None:
        drops = math.floor(epochs_done / self.config.decay_epochs + 1e-9)
        for group in self.optimizer.param_groups:
            group["lr"] = self.config.learning_rate * self.config.decay**drops

    def _validate(self, *, whole_epoch: bool) -> None:
        if self.scalars is not None:  # the other processes wait for the next step of the first
            figures, weights = self._figures_and_weights()
        if whole_epoch:
            self.progress.epoch, self.progress.step = self.progress.epoch + 1, 0
        if self.scalars is None:
            return
        self.progress.history.add_figures(self.progress.total_steps, figures)
        # The module has its own weights again, so that this may write a checkpoint.
        self.files.keep_if_best(figures, weights, self.progress, whole_epoch=whole_epoch)
        for name, figure in figures.items():
            self.scalars.add(f"val/{name}", figure, self.progress.total_steps)
        text = ", ".join(f"{name} {figure:.4g}" for name, figure in figures.items())
        self.display.say(f"validation after {counted(self.progress.total_steps, 'step')}: {text}")

    def _figures_and_weights(self) -> tuple[dict[str, float], dict[str, torch.Tensor]]:
        """Return the figures of the mean weights, and the mean weights at this step."""
        with self.signals.ending_at_once(), self.average.applied():
            self.module.eval()
            figures = self.trainee.validate()
            self.module.train()
            weights = self.module.state_dict()
            return figures, {name: each.detach().cpu().clone() for name, each in weights.items()}

    def _report_and_save(self, batches: Sequence[Items]) -> None:
        now, progress, total = time.monotonic(), self.progress, len(batches)
        epoch = f"{progress.epoch + 1}/{self.config.epochs}"
        left = self._seconds_left(self._steps_an_epoch(batches))
        self.display.step(epoch, progress.step, total, self._losses, left)
        if self.scalars is not None and now - self._logged > LOG_SECONDS:
            self._logged = now
            for name, value in self._losses.items():
                self.scalars.add(f"train/{name}", value, progress.total_steps)
        if now - self.files.saved > CHECKPOINT_SECONDS:
            self._save_checkpoint()

    def _seconds_left(self, steps_an_epoch: int) -> float:
        done = self.progress.total_steps - self._steps_before
        total = self.config.epochs * steps_an_epoch - self._steps_before
        seconds = self._elapsed() / done * (total - done)
        return max(0.0, min(seconds, self._limit - self._elapsed()))

    def _save_checkpoint(self) -> None:
        if self.processes.is_first:
            self.files.save_checkpoint(self.progress)
            set_farewell("--resume continues the training")

    def _elapsed(self) -> float:
        return time.monotonic() - self._began

    def _stop_alone(self) -> Callable[[], bool]:
        """Return the test whether to stop in mid-step, never true with several processes."""
        alone = self.processes.count == 1
        return lambda: alone and self.signals.reason is not StopReason.NONE

    def _why_stop(self) -> StopReason:
        """Return the reason to stop, equal in all processes; a time limit lets one step pass."""
        own = self.signals.reason
        has_advanced = self.progress.total_steps > self._steps_before
        if has_advanced and self._elapsed() > self._limit:
            own = max(own, StopReason.TIME_LIMIT)
        return StopReason(self.processes.most(own))
