"""Files of a training: its checkpoint, the best weights so far, the curves.

A finished run leaves the best weights of all ends of epochs. A run that stops within an epoch is
validated there too, and may leave the weights of that step; a resumed run forgets these weights, so
that the result does not depend on the place of the stop. Files are written whole or not at all, by
the first process alone.
"""

import copy
import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor

from pipelines.contents import reading
from pipelines.errors import FormatError, ValueRangeError
from pipelines.learning.loop.runs import (
    CHECKPOINT,
    CURVES,
    FAULT,
    TRAIN_AGAIN,
    Progress,
    file_of_run,
    remove_other_weights,
    warn_of_damage,
)
from pipelines.learning.loop.trainee import Trainee
from pipelines.learning.progress.curves import write_curves
from pipelines.learning.speed.weight_average import WeightAverage
from pipelines.network.weights_files import fill
from pipelines.storage.checkpoints import (
    TrainingState,
    by_kind,
    load_training,
    save_training,
    save_weights,
)
from pipelines.storage.provenance import Stamp


class RunFiles:
    """Writes the files of a training and restores its state."""

    def __init__(
        self,
        trainee: Trainee,
        optimizer: torch.optim.Optimizer,
        average: WeightAverage,
        output: Path,
        stamp: Stamp,
        metadata: Mapping[str, str],
    ) -> None:
        self.trainee, self.optimizer, self.average = trainee, optimizer, average
        self.output, self.stamp, self.metadata = output, stamp, dict(metadata)
        self.saved = time.monotonic()
        self._best: dict[str, Tensor] = {}
        self._is_begun = False

    def restore(self, *, or_anew: bool = False) -> Progress:
        """Restore the state of the checkpoint, and return its progress.

        `or_anew`: if the checkpoint is damaged, leave the state as it is, and return no progress.

        Raises:
            FormatError: the checkpoint is damaged, unless `or_anew`.
        """
        start = copy.deepcopy((self.trainee.module.state_dict(), self.optimizer.state_dict()))
        try:
            return self._restored()
        except FormatError as error:
            if not or_anew:
                raise
            warn_of_damage(error)
        self.trainee.module.load_state_dict(start[0])
        self.optimizer.load_state_dict(start[1])
        self.average.load(start[0])
        return Progress()

    def _restored(self) -> Progress:
        path = file_of_run(self.output, CHECKPOINT)
        state = load_training(path)
        with reading(path, "the state of the training", TRAIN_AGAIN):
            kinds = by_kind(state.model, ("weights", "average", "best"))
            for kind in ("best", "average", "weights"):  # the module is left with its weights
                fill(self.trainee.module, kinds["weights"] | kinds[kind], path)
            self.average.load(kinds["average"])
            self.optimizer.load_state_dict(state.optimizer)
            for parameter, kept in self.optimizer.state.items():
                shapes = {name: each.shape for name, each in kept.items()}
                moments = dict.fromkeys(("exp_avg", "exp_avg_sq"), parameter.shape)
                if shapes != {"step": torch.Size([]), **moments}:
                    raise ValueError("the optimiser's state is not Adam's")
        progress = Progress.of(state.progress, path)
        self._best = kinds["best"]
        return progress

    def save_checkpoint(self, progress: Progress) -> None:
        """Write everything that the training needs to continue."""
        if not self._is_begun:  # before the checkpoint: that of the other run can restore them
            remove_other_weights(self.output, self.stamp)
            self._is_begun = True
        now = time.monotonic()
        progress.seconds += now - self.saved
        self.saved = now
        groups = {
            "weights": self.trainee.module.state_dict(),
            "average": self.average.state(),
            "best": self._best,
        }
        model = {f"{kind}.{n}": each for kind, group in groups.items() for n, each in group.items()}
        state = TrainingState(model, self.optimizer.state_dict(), asdict(progress))
        save_training(file_of_run(self.output, CHECKPOINT), state, self.stamp)

    def keep_if_best(
        self,
        figures: dict[str, float],
        weights: dict[str, Tensor],
        progress: Progress,
        *,
        whole_epoch: bool,
    ) -> None:
        """Keep `weights`, which have these `figures`, if they are the best so far."""
        better = self._is_better(figures[self.trainee.best_by], progress.best)
        if whole_epoch:
            if better:
                progress.best, progress.figures = figures[self.trainee.best_by], figures
                self._best = weights
            # The output may have the weights of the step at which an earlier run stopped.
            if self._best and (better or progress.kept != progress.figures):
                self._write_best(progress)
        elif better:
            progress.kept = figures
            # The checkpoint comes first: a kill between the two writes loses nothing.
            self.save_checkpoint(progress)
            self._write(weights, figures)
        write_curves(file_of_run(self.output, CURVES), progress.history, self.trainee.best_by)

    def finish(self, progress: Progress) -> None:
        """Write the best weights of a finished run, if a kill has prevented that.

        A faulty batch of an earlier try is removed: this run has passed it.
        """
        file_of_run(self.output, FAULT).unlink(missing_ok=True)
        if self._best and (progress.kept != progress.figures or not self.output.exists()):
            self._write_best(progress)

    def refuse_no_weights(self, progress: Progress) -> None:
        """Raise ValueRangeError if no weights of a finished run are the best.

        Otherwise a run without an output would look like any other.
        """
        if progress.best is None:
            found = progress.history.val.get(self.trainee.best_by, [(0, math.nan)])[-1][1]
            expected = f"finite; {self.output} is not written; a lower learning rate may help"
            raise ValueRangeError(f"{self.trainee.best_by} of all validations", found, expected)

    def _write_best(self, progress: Progress) -> None:
        # The checkpoint comes first: weights without one would be taken for another run's.
        self.save_checkpoint(progress)
        self._write(self._best, progress.figures)
        progress.kept = progress.figures

    def _is_better(self, value: float, best: float | None) -> bool:
        sign = 1.0 if self.trainee.higher_is_better else -1.0
        return math.isfinite(value) and (best is None or sign * value > sign * best)

    def _write(self, weights: Mapping[str, Tensor], figures: Mapping[str, float]) -> None:
        metadata = self.metadata | {"validation": json.dumps(figures, sort_keys=True)}
        save_weights(self.output, weights, metadata, self.stamp)
