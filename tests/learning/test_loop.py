"""The engine on a small problem whose answer is known: resume, threads, limits, faults."""

import math

import numpy as np
import pytest
import torch
from torch import nn

from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.formats.checkpoints import load_weights
from pipelines.formats.provenance import make_stamp
from pipelines.learning.loop import LoopOptions, TrainingRun
from pipelines.learning.runs import Progress, RunRequest, checkpoint_path, find_progress

OPTIONS = LoopOptions(epochs=3, learning_rate=0.01, decay=0.5, decay_epochs=1.0, ema_decay=0.9)
STAMP = make_stamp("train", {"a": 1})


class Line:
    """Fit y = 2 x with a network that has batch norm, so that buffers matter."""

    best_by, higher_is_better, parallel = "loss", False, True

    def __init__(self, faulty_step=None):
        torch.manual_seed(0)
        self.module = nn.Sequential(nn.Linear(1, 8), nn.BatchNorm1d(8), nn.ReLU(), nn.Linear(8, 1))
        self.faulty_step, self.validated = faulty_step, 0

    def epoch(self, rng):
        return list(rng.permutation(10))

    def load(self, batch, rng):
        x = torch.from_numpy(rng.normal(size=(8, 1))).float() + 0.01 * int(batch)
        if batch == self.faulty_step:
            x = x * math.nan
        return [(0.5, x[:4]), (0.5, x[4:])]

    def loss(self, module, micro_batch, generator):
        noisy = micro_batch + 0.01 * torch.randn(micro_batch.shape, generator=generator)
        return {"total": (module(noisy) - 2.0 * micro_batch).square().mean()}

    def validate(self):
        self.validated += 1
        x = torch.linspace(-1.0, 1.0, 20)[:, None]
        with torch.no_grad():
            return {"loss": float((self.module(x) - 2.0 * x).square().mean())}


def trained(output, options=OPTIONS, resume=False, trainee=None):
    run = TrainingRun(trainee or Line(), options, output, STAMP, {"model": "Line"})
    if resume:
        run.resume()
    return run, run.run()


def stop_after(run, steps):
    """Let `run` believe that its time is over after `steps` steps."""
    run._out_of_time = lambda: run.progress.total_steps >= steps


@pytest.mark.parametrize("steps", [4, 10, 17])
def test_a_resumed_run_ends_with_the_same_bytes_as_one_that_never_stopped(tmp_path, steps):
    trained(tmp_path / "whole.safetensors")
    output = tmp_path / "halves.safetensors"
    first = TrainingRun(Line(), OPTIONS, output, STAMP, {"model": "Line"})
    stop_after(first, steps)
    assert not first.run().finished
    _, progress = trained(output, resume=True)
    assert progress.finished
    whole, halves = (
        load_weights(checkpoint_path(tmp_path / f"{name}.safetensors"))[0]
        for name in ("whole", "halves")
    )
    assert whole.keys() == halves.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, halves[name]), name


def test_the_number_of_threads_changes_nothing(tmp_path):
    for threads in (1, 2):
        options = LoopOptions(**{**vars(OPTIONS), "threads": threads})
        trained(tmp_path / f"{threads}.safetensors", options)
    one, two = (load_weights(tmp_path / f"{n}.safetensors")[0] for n in (1, 2))
    assert all(torch.equal(one[name], two[name]) for name in one)


def test_training_learns(tmp_path):
    before = Line().validate()["loss"]
    options = LoopOptions(**{**vars(OPTIONS), "epochs": 12, "decay": 1.0})
    _, progress = trained(tmp_path / "line.safetensors", options)
    assert progress.best < 0.3 * before


def test_the_output_holds_the_best_weights_and_says_how_good_they_are(tmp_path):
    run, progress = trained(tmp_path / "line.safetensors")
    tensors, metadata = load_weights(tmp_path / "line.safetensors")
    run.module.load_state_dict(tensors)
    run.module.eval()
    assert run.trainee.validate()["loss"] == pytest.approx(progress.best, rel=1e-5)
    assert str(progress.best)[:6] in metadata["validation"]
    assert metadata["model"] == "Line"


def test_the_learning_rate_drops_on_its_schedule(tmp_path):
    run, _ = trained(tmp_path / "line.safetensors")
    assert run.optimizer.param_groups[0]["lr"] == pytest.approx(0.01 * 0.5**2)


def test_a_time_limit_stops_cleanly_with_a_checkpoint(tmp_path):
    options = LoopOptions(**{**vars(OPTIONS), "time_limit": 0.0})
    _, progress = trained(tmp_path / "line.safetensors", options)
    assert not progress.finished
    assert checkpoint_path(tmp_path / "line.safetensors").exists()


def test_a_loss_that_is_not_finite_stops_with_a_sentence(tmp_path):
    with pytest.raises(ValueRangeError, match=r"loss at epoch 1, step \d+ .* finite"):
        trained(tmp_path / "line.safetensors", trainee=Line(faulty_step=3))


def test_an_unfinished_run_asks_what_to_do(tmp_path):
    output = tmp_path / "line.safetensors"
    trained(output, LoopOptions(**{**vars(OPTIONS), "time_limit": 0.0}))
    with pytest.raises(SymgraspError, match="--resume"):
        find_progress(output, STAMP, RunRequest())
    assert find_progress(output, STAMP, RunRequest(overwrite=True)) is None
    assert isinstance(find_progress(output, STAMP, RunRequest(resume=True)), Progress)


def test_a_run_of_other_settings_is_not_resumed(tmp_path):
    trained(tmp_path / "line.safetensors")
    with pytest.raises(SymgraspError, match="another config"):
        find_progress(
            tmp_path / "line.safetensors", make_stamp("train", {"a": 2}), RunRequest(resume=True)
        )


def test_scalars_are_kept_for_tensorboard(tmp_path):
    trained(tmp_path / "line.safetensors")
    assert list((tmp_path / "line.logs").glob("events*"))


def test_batches_depend_on_seed_and_epoch_alone():
    first, second = (Line().epoch(np.random.default_rng((0, 1))) for _ in range(2))
    assert first == second
