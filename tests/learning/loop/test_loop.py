"""The training loop on a small problem with a known answer: resume, threads, limits, faults."""

import contextlib
import itertools
import json
import math
import os
import shutil
import signal
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest
import torch
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import nn

from pipelines import ending
from pipelines.configs import TrainBaselineConfig, TrainConfig
from pipelines.errors import FormatError, SymgraspError, ValueRangeError, WriteError
from pipelines.learning.loop import loop
from pipelines.learning.loop.faults import read_fault
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import (
    CHECKPOINT,
    CURVES,
    FAULT,
    Progress,
    RunRequest,
    file_of_run,
    find_progress,
)
from pipelines.learning.speed.gradients import GradientWorkers
from pipelines.learning.speed.micro_batches import generator, micro_batches_of
from pipelines.learning.speed.processes import Processes
from pipelines.runtime.stopping import StopReason, StopSignals, TrainingStopped
from pipelines.storage.checkpoints import load_weights, save_weights
from pipelines.storage.provenance import make_stamp
from tests.storage.full_disk import little_space

CONFIG = TrainConfig(epochs=3, learning_rate=0.01, decay=0.5, decay_epochs=1.0, ema_decay=0.9)
REQUEST = RunRequest(threads=1)
STAMP = make_stamp("train", {"a": 1})
PLACE = '{"seed": 0, "epoch": 1, "step": 2, "micro_batch": 0}'


class Line:
    """Fit y = 2 x with a network that has batch norm, so that buffers matter."""

    best_by, higher_is_better, parallel = "loss", False, True
    micro_batch_size = 4

    def __init__(self, faulty_item=None):
        torch.manual_seed(0)
        self.module = nn.Sequential(nn.Linear(1, 8), nn.BatchNorm1d(8), nn.ReLU(), nn.Linear(8, 1))
        self.faulty_item, self.validated = faulty_item, 0

    def epoch(self, number, rng):
        return list(rng.permutation(80).reshape(10, 8))

    def load(self, items, generators):
        x = [
            math.nan if item == self.faulty_item else rng.normal() + 0.01 * item
            for item, rng in zip(items, generators, strict=True)
        ]
        return torch.tensor(x, dtype=torch.float32)[:, None]

    def loss(self, module, micro_batch, generator):
        noisy = micro_batch + 0.01 * torch.randn(micro_batch.shape, generator=generator)
        return {"total": (module(noisy) - 2.0 * micro_batch).square().mean()}

    def tensors(self, micro_batch):
        return {"x": micro_batch}

    def validate(self):
        self.validated += 1
        x = torch.linspace(-1.0, 1.0, 20)[:, None]
        with torch.no_grad():
            return {"loss": float((self.module(x) - 2.0 * x).square().mean())}


class Restless(Line):
    """Best in the middle of an epoch; of the ends of epochs, best at the first."""

    def validate(self):
        super().validate()
        steps = int(self.module[1].num_batches_tracked)
        return {"loss": 3.0 + steps / 100 if steps % 10 == 0 else 1.0 - steps / 100}


class Shortened(Line):
    """Ten batches an epoch, five in the third."""

    def epoch(self, number, rng):
        return super().epoch(number, rng)[: 10 if number < 2 else 5]


class Killed(BaseException):
    """Raised in the place of a SIGKILL, so that the test goes on."""


def new_run(output, trainee, config=CONFIG, request=REQUEST):
    return TrainingRun(trainee, config, request, output, STAMP, {"model": "Line"})


def trained(output, config=CONFIG, request=REQUEST, resume=False, trainee=None):
    run = new_run(output, trainee or Line(), config, request)
    if resume:
        run.resume()
    return run, run.run()


def stop_after(run, steps):
    """Let `run` reach its time limit after `steps` steps."""
    run._why_stop = lambda: (
        StopReason.TIME_LIMIT if run.progress.total_steps >= steps else StopReason.NONE
    )


def stopped_after(steps, output):
    """Return the checkpoint of a run that stopped after `steps` steps."""
    run = new_run(output, Line())
    stop_after(run, steps)
    run.run()
    return file_of_run(output, CHECKPOINT)


def assert_same(first, second):
    """Assert that kept weights and all tensors of the checkpoints are equal, bit for bit."""
    assert first.read_bytes() == second.read_bytes()
    one, other = (load_weights(file_of_run(each, CHECKPOINT))[0] for each in (first, second))
    assert one.keys() == other.keys()
    for name, tensor in one.items():
        assert torch.equal(tensor, other[name]), name


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Outputs of runs that never stopped, by trainee."""
    outputs = {}
    for kind in (Line, Restless):
        outputs[kind] = tmp_path_factory.mktemp("whole") / "line.safetensors"
        trained(outputs[kind], trainee=kind())
    return outputs


@pytest.mark.parametrize("kind", [Line, Restless])
@pytest.mark.parametrize("steps", [[4], [10], [3, 14, 17], [29]])
def test_a_resumed_run_ends_with_the_same_bytes_as_one_that_never_stopped(
    tmp_path, whole, kind, steps
):
    output = tmp_path / "line.safetensors"
    for count in steps:
        run = new_run(output, kind())
        if file_of_run(output, CHECKPOINT).exists():
            run.resume()
        stop_after(run, count)
        assert not run.run().finished
        assert output.exists()  # the weights so far are there even if the run is not resumed
    _, progress = trained(output, resume=True, trainee=kind())
    assert progress.finished
    assert_same(output, whole[kind])


def test_weights_of_a_stopped_run_may_be_better_than_at_any_end_of_an_epoch(tmp_path):
    """This case makes the test above meaningful."""
    run = new_run(tmp_path / "x.safetensors", Restless())
    stop_after(run, 14)
    progress = run.run()
    assert progress.kept["loss"] < progress.figures["loss"] == progress.best
    assert "0.86" in load_weights(tmp_path / "x.safetensors")[1]["validation"]


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(st.integers(0, 45), max_size=3), st.sampled_from([Line, Restless]))
@example([0, 5], Line)  # killed after a stop within an epoch has validated the mean of the weights
def test_a_run_killed_at_any_moment_and_resumed_gives_the_same_bytes(whole, moments, kind):
    """Moments are counted in steps and written files; a kill comes just before or after one."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "line.safetensors"
        for number, moment in enumerate(moments):
            run = new_run(output, kind())
            if file_of_run(output, CHECKPOINT).exists():
                run.resume()
            if number == 1:
                stop_after(run, run.progress.total_steps + moment // 3)
            kill_at(run, moment)
            with contextlib.suppress(Killed), mock.patch.object(loop, "CHECKPOINT_SECONDS", 0.0):
                run.run()
        run = new_run(output, kind())
        if find_progress(output, STAMP, RunRequest(resume=True)) is not None:
            run.resume()
        run.run()
        assert_same(output, whole[kind])


def kill_at(run, moment):
    """Kill `run` at its `moment`-th event: a step, or before or after it writes a file."""
    events = itertools.count()

    def dying(function):
        def wrapped(*arguments, **named):
            if next(events) == moment:
                raise Killed
            result = function(*arguments, **named)
            if next(events) == moment:
                raise Killed
            return result

        return wrapped

    run._step = dying(run._step)
    run.files._write = dying(run.files._write)
    run.files.save_checkpoint = dying(run.files.save_checkpoint)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_after_the_step_with_a_checkpoint(tmp_path, whole, number):
    output, trainee = tmp_path / "line.safetensors", Line()
    load, calls = trainee.load, itertools.count()

    def signalled(items, generators):
        if next(calls) == 9:
            os.kill(os.getpid(), number)
        return load(items, generators)

    trainee.load = signalled
    before = signal.getsignal(number)
    with pytest.raises(TrainingStopped, match=rf"{number.name} after \d+ steps?\b.*--resume"):
        trained(output, trainee=trainee)
    assert signal.getsignal(number) is before
    trained(output, resume=True)
    assert_same(output, whole[Line])


class EndedError(Exception):
    pass


@contextlib.contextmanager
def ending_at_once(number):
    """Expect that the command line's signal handler ends the code in this context."""

    def end(*_):
        raise EndedError

    before = signal.signal(number, end)
    try:
        with pytest.raises(EndedError):
            yield
    finally:
        signal.signal(number, before)


def signalled_by(number):
    """Return a function that sends a signal, after which no code runs."""

    def signalled(*_):
        os.kill(os.getpid(), number)
        raise AssertionError("it goes on")

    return signalled


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_during_validation_ends_at_once_and_loses_no_step(tmp_path, whole, number):
    output, trainee = tmp_path / "line.safetensors", Line()
    trainee.validate = signalled_by(number)
    with ending_at_once(number):
        trained(output, trainee=trainee)
    steps = find_progress(output, STAMP, RunRequest(resume=True)).total_steps
    assert steps == len(Line().epoch(0, generator(0, 0)))
    trained(output, resume=True)
    assert_same(output, whole[Line])


def test_a_signal_during_validation_names_the_option_that_continues(tmp_path, monkeypatch, capfd):
    output, trainee, end = tmp_path / "line.safetensors", Line(), mock.Mock(side_effect=EndedError)
    trainee.validate = signalled_by(signal.SIGTERM)
    monkeypatch.setattr(ending, "end", end)
    monkeypatch.setattr(ending, "_farewell", "the same command continues from here")
    before = signal.signal(signal.SIGTERM, ending.end_by_signal)
    try:
        with pytest.raises(EndedError):
            trained(output, trainee=trainee)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert "stopped by SIGTERM; --resume continues the training\n" in capfd.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_before_the_first_step_ends_at_once(tmp_path, monkeypatch, number):
    output = tmp_path / "line.safetensors"
    monkeypatch.setattr(TrainingRun, "_new_scalars", signalled_by(number))
    with ending_at_once(number):
        trained(output)
    assert not output.exists()


def test_a_long_step_is_abandoned_between_its_micro_batches(tmp_path, whole):
    output, trainee = tmp_path / "line.safetensors", Line()
    loss, calls = trainee.loss, itertools.count()

    def signalled(*arguments):
        if next(calls) == 4:
            os.kill(os.getpid(), signal.SIGTERM)
        return loss(*arguments)

    trainee.loss = signalled
    with pytest.raises(TrainingStopped) as stopped:
        trained(output, trainee=trainee)
    assert stopped.value.exit_code == 143
    assert next(calls) == 5
    assert find_progress(output, STAMP, RunRequest(resume=True)).total_steps == 2
    trained(output, resume=True)
    assert_same(output, whole[Line])


def test_a_command_with_overwrite_and_resume_resumes_its_own_run_and_replaces_another(
    tmp_path, whole
):
    output = tmp_path / "line.safetensors"
    for path in whole[Line], file_of_run(whole[Line], CHECKPOINT):
        shutil.copy(path, tmp_path)
    both = RunRequest(resume=True, overwrite=True)
    assert find_progress(output, STAMP, both) is not None
    assert find_progress(output, replace(STAMP, seed=STAMP.seed + 1), both) is None
    assert find_progress(output, STAMP, RunRequest(overwrite=True)) is None


@pytest.mark.parametrize("content", [b"", b"cut off"])
def test_a_damaged_checkpoint_is_overwritten_on_request(tmp_path, content):
    output = tmp_path / "line.safetensors"
    file_of_run(output, CHECKPOINT).write_bytes(content)
    with pytest.raises(FormatError, match="not a whole safetensors file"):
        find_progress(output, STAMP, RunRequest())
    assert find_progress(output, STAMP, RunRequest(overwrite=True)) is None


@pytest.mark.parametrize("name", [None, "model.best.0.weight", "optimizer.0.exp_avg"])
def test_a_command_with_overwrite_and_resume_starts_again_from_a_damaged_checkpoint(
    tmp_path, whole, caplog, name
):
    output, both = tmp_path / "line.safetensors", replace(REQUEST, resume=True, overwrite=True)
    run = new_run(output, Line())
    stop_after(run, 14)
    run.run()
    checkpoint = file_of_run(output, CHECKPOINT)
    if name is None:
        checkpoint.write_bytes(b"cut off")
    else:
        tensors, metadata = load_weights(checkpoint)
        halve(tensors, name)
        save_weights(checkpoint, tensors, metadata)
    earlier = find_progress(output, STAMP, both)
    assert (earlier is None) == (name is None)
    trained(output, request=both, resume=earlier is not None)
    assert "the training starts again" in caplog.text
    assert_same(output, whole[Line])


def test_missing_weights_are_written_again_from_the_checkpoint(tmp_path, whole):
    output = tmp_path / "line.safetensors"
    for path in whole[Line], file_of_run(whole[Line], CHECKPOINT):
        shutil.copy(path, tmp_path)
    output.unlink()
    earlier = find_progress(output, STAMP, RunRequest())
    assert earlier is not None
    assert not earlier.finished
    _, progress = trained(output, resume=True)
    assert progress.finished
    assert_same(output, whole[Line])
    assert find_progress(output, STAMP, RunRequest()).finished


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda tensors, progress: progress.update(step=-1), "a number of steps is negative"),
        (lambda tensors, progress: progress.update(epoch="1"), "is of the wrong type"),
        (lambda tensors, progress: progress.update(other=1), "`other` is not known"),
        (lambda tensors, progress: progress["history"].update(val={"loss": [[1]]}), "zip"),
        (lambda tensors, progress: tensors.pop("model.average.0.weight"), "lacks '0.weight'"),
        (lambda tensors, progress: tensors.pop("model.weights.0.weight"), "do not fit the network"),
        (lambda tensors, progress: tensors.update({"model.x.y": torch.ones(1)}), "lacks 'x'"),
        (lambda tensors, progress: halve(tensors, "model.best.0.weight"), "do not fit the network"),
        (lambda tensors, progress: halve(tensors, "model.average.0.weight"), "do not fit the net"),
        (lambda tensors, progress: halve(tensors, "optimizer.0.exp_avg"), "not Adam's"),
        (lambda tensors, progress: tensors.pop("optimizer.0.exp_avg"), "not Adam's"),
    ],
)
def test_a_damaged_checkpoint_is_refused_in_a_sentence(tmp_path, damage, message):
    output = tmp_path / "line.safetensors"
    checkpoint = stopped_after(14, output)
    tensors, metadata = load_weights(checkpoint)
    progress = json.loads(metadata["progress"])
    damage(tensors, progress)
    save_weights(checkpoint, tensors, metadata | {"progress": json.dumps(progress)})
    with pytest.raises(FormatError, match=message):
        resume(output)


def resume(output):
    """Read the checkpoint as a resumed training does."""
    find_progress(output, STAMP, RunRequest(resume=True))
    new_run(output, Line()).resume()


def halve(tensors, name):
    """Leave out the second half of the tensor `name`."""
    tensors[name] = tensors[name].flatten()[: tensors[name].numel() // 2]


@pytest.fixture
def interruptible():
    """Let Python handle SIGINT, even where a shell ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_a_second_interrupt_does_not_wait():
    signals = StopSignals()
    with signals.recorded(expects_repeats=False):
        os.kill(os.getpid(), signal.SIGINT)
        assert signals.reason is StopReason.SIGINT
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    with signals.recorded(expects_repeats=True):
        os.kill(os.getpid(), signal.SIGINT)


def test_the_number_of_threads_changes_nothing(tmp_path):
    for threads in (1, 2):
        trained(tmp_path / f"{threads}.safetensors", request=RunRequest(threads=threads))
    one, two = (load_weights(tmp_path / f"{n}.safetensors")[0] for n in (1, 2))
    assert all(torch.equal(one[name], two[name]) for name in one)


def test_training_learns(tmp_path):
    before = Line().validate()["loss"]
    config = replace(CONFIG, epochs=12, decay=1.0)
    _, progress = trained(tmp_path / "line.safetensors", config)
    assert progress.best < 0.3 * before


def test_the_output_holds_the_best_weights_and_their_validation_figures(tmp_path):
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


def test_the_learning_rate_drops_by_steps_in_a_last_shorter_epoch_too(tmp_path):
    config = TrainBaselineConfig(
        steps=25, epoch_steps=10, batch_size=8, learning_rate=0.01, decay=0.5, decay_steps=11
    )
    run = new_run(tmp_path / "line.safetensors", Shortened(), config)
    rates, step = [], run.optimizer.step

    def recorded():
        rates.append(run.optimizer.param_groups[0]["lr"])
        step()

    run.optimizer.step = recorded
    run.run()
    assert rates == pytest.approx([0.01 * 0.5 ** (done // 11) for done in range(25)])


def test_the_time_left_is_never_negative_in_a_last_shorter_epoch(tmp_path):
    config = TrainBaselineConfig(
        steps=25, epoch_steps=10, batch_size=8, learning_rate=0.01, decay_steps=11
    )
    run = new_run(tmp_path / "line.safetensors", Shortened(), config)
    left, seconds_left = [], run._seconds_left

    def recorded(steps):
        left.append(seconds_left(steps))
        return left[-1]

    run._seconds_left = recorded
    run.run()
    assert min(left) >= 0.0


def test_a_time_limit_stops_cleanly_with_a_checkpoint(tmp_path):
    request = replace(REQUEST, max_seconds=0.0)
    _, progress = trained(tmp_path / "line.safetensors", request=request)
    assert not progress.finished
    assert file_of_run(tmp_path / "line.safetensors", CHECKPOINT).exists()


def test_each_of_a_series_of_short_runs_takes_a_step(tmp_path, whole):
    output, request = tmp_path / "line.safetensors", replace(REQUEST, max_seconds=0.0)
    counts = []
    for resume in [False, *[True] * 29]:
        _, progress = trained(output, request=request, resume=resume)
        counts.append(progress.total_steps)
    assert counts == list(range(1, 31))
    assert progress.finished
    assert_same(output, whole[Line])


def test_a_run_without_a_finite_validation_fails_in_a_sentence(tmp_path):
    class Lost(Line):
        def validate(self):
            return {"loss": math.nan}

    output = tmp_path / "line.safetensors"
    for resume in (False, True):
        with pytest.raises(ValueRangeError, match=r"loss of all validations is nan.*not written"):
            trained(output, trainee=Lost(), resume=resume)
        assert not output.exists()


@pytest.mark.parametrize("is_whole", [True, False])
def test_weights_of_another_run_do_not_pass_for_those_of_a_new_run(tmp_path, whole, is_whole):
    class Lost(Line):
        def validate(self):
            return {"loss": math.nan}

    output = tmp_path / "line.safetensors"
    save_weights(output, load_weights(whole[Line])[0], {}, replace(STAMP, seed=1))
    if not is_whole:
        output.write_bytes(b"cut off")
    for resume in (False, True):
        with pytest.raises(ValueRangeError, match="not written"):
            trained(output, replace(CONFIG, epochs=1), trainee=Lost(), resume=resume)
        assert not output.exists()
        assert not find_progress(output, STAMP, REQUEST).finished


def test_a_loss_that_is_not_finite_stops_with_a_sentence_and_keeps_the_batch(tmp_path):
    output, trainee = tmp_path / "line.safetensors", Line(faulty_item=33)
    with pytest.raises(ValueRangeError, match=r"loss at epoch 1, step \d+ .* finite.*holds the"):
        trained(output, trainee=trainee)
    fault = read_fault(file_of_run(output, FAULT), "train")
    assert torch.isnan(fault.batch["x"]).sum() == 1
    assert fault.settings == {"a": 1}
    batches = Line().epoch(0, generator(0, 0))
    step = next(i for i, batch in enumerate(batches) if 33 in batch)
    number = list(batches[step]).index(33) // 4
    assert fault.place == (0, 0, step, number)
    # The same items, drawn again at that place, equal the saved ones.
    items, first = batches[step][4 * number :][:4], 4 * number
    again = Line(33).load(items, [generator(0, 0, step, first + i) for i in range(4)])
    torch.testing.assert_close(again, fault.batch["x"], equal_nan=True)
    # The weights before that batch are there to try the batch on.
    trainee.module.load_state_dict(dict(fault.weights))
    assert all(value.isfinite().all() for value in fault.weights.values())


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({}, "holds no faulty batch; NAME.fault.safetensors of train is expected"),
        ({"place": "[0, 0, 0, 0]"}, "the place is no JSON object"),
        ({"place": '{"seed": 0}'}, "the faulty batch is not right .lacks 'epoch'."),
        ({"place": PLACE.replace("2", '"2"')}, 'the faulty batch is not right .\\"2\\" is of'),
        ({"place": PLACE, "provenance": "null"}, "the stamp is no JSON object"),
        ({"place": PLACE, "provenance": '{"stage": "infer"}'}, "holds a batch of infer"),
    ],
)
def test_a_file_that_holds_no_faulty_batch_is_refused_in_a_sentence(tmp_path, metadata, message):
    path, stamped = tmp_path / "line.fault.safetensors", {"provenance": STAMP.as_text()}
    save_weights(path, {"batch.x": torch.zeros(1)}, stamped | metadata)
    with pytest.raises(FormatError, match=message):
        read_fault(path, "train")


def test_a_gradient_that_is_not_finite_stops_too(tmp_path):
    class Steep(Line):
        def loss(self, module, micro_batch, generator):
            terms = super().loss(module, micro_batch, generator)
            flat = torch.zeros(1, requires_grad=True) + 0.0 * module[0].weight.sum()
            return {"total": terms["total"] + flat.abs().sqrt().sum()}  # 0, with an infinite slope

    with pytest.raises(ValueRangeError, match="gradient nan"):
        trained(tmp_path / "line.safetensors", trainee=Steep())
    assert file_of_run(tmp_path / "line.safetensors", FAULT).exists()


def test_a_finished_run_removes_the_faulty_batch_that_it_has_passed(tmp_path):
    output = tmp_path / "line.safetensors"
    stopped_after(4, output)
    file_of_run(output, FAULT).write_bytes(b"of an earlier try")
    trained(output, resume=True)
    assert not file_of_run(output, FAULT).exists()


@pytest.mark.parametrize("size", [1, 2, 8])
def test_accumulated_gradients_are_those_of_the_whole_batch(size):
    class Plain(Line):
        micro_batch_size = size

        def loss(self, module, micro_batch, generator):
            module.eval()  # only batch norm's statistics depend on the micro-batch
            return {"total": (module(micro_batch) - 2.0 * micro_batch).square().mean()}

    trainee = Plain()
    batch = trainee.epoch(0, generator(0, 0))[0]
    loaded = [(p, p.load(trainee, 0, 0, 0)) for p in micro_batches_of(batch, size, Processes())]
    with GradientWorkers(trainee, 1) as workers:
        losses, gradients = workers.gradients(loaded, (0, 0, 0))
    (whole,) = micro_batches_of(batch, 8, Processes())
    terms = trainee.loss(trainee.module, whole.load(trainee, 0, 0, 0), None)
    expected = torch.autograd.grad(terms["total"], list(trainee.module.parameters()))
    assert losses["total"] == pytest.approx(float(terms["total"].detach()), rel=1e-5)
    for ours, theirs in zip(gradients, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-6)


def test_an_unfinished_run_is_refused_without_resume_or_overwrite(tmp_path):
    output = tmp_path / "line.safetensors"
    trained(output, request=replace(REQUEST, max_seconds=0.0))
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


def test_the_curves_of_a_training_that_starts_anew_show_no_earlier_one(tmp_path):
    output, tag = tmp_path / "line.safetensors", "val/loss"
    for epochs in (3, 2):
        trained(output, replace(CONFIG, epochs=epochs))
        time.sleep(1.1)  # TensorBoard's files are ordered by their names, which count seconds
    read = EventAccumulator(str(tmp_path / "line.logs"))
    read.Reload()
    steps = [event.step for event in read.Scalars(tag)]
    assert len(steps) == 2
    assert steps == sorted(steps)


def test_a_full_disk_is_reported_in_one_sentence_without_a_traceback(tmp_path, capfd):
    with little_space(0), pytest.raises(WriteError, match=r"events.* cannot be written"):
        trained(tmp_path / "line.safetensors")
    assert "Traceback" not in capfd.readouterr().err


def test_a_resumed_run_keeps_the_scalars_of_all_validations(tmp_path):
    output = tmp_path / "line.safetensors"
    run = new_run(output, Line())
    stop_after(run, 20)  # the end of an epoch
    run.run()
    time.sleep(1.1)  # as above
    trained(output, resume=True)
    read = EventAccumulator(str(tmp_path / "line.logs"))
    read.Reload()
    assert [event.step for event in read.Scalars("val/loss")] == [10, 20, 30]


def test_a_checkpoint_of_another_version_is_resumed_with_a_warning(tmp_path, caplog):
    output = tmp_path / "line.safetensors"
    checkpoint = stopped_after(1, output)
    tensors, metadata = load_weights(checkpoint)
    stamp = json.loads(metadata["provenance"]) | {"version": "0.0.5"}
    save_weights(checkpoint, tensors, metadata | {"provenance": json.dumps(stamp)})
    assert find_progress(output, STAMP, replace(REQUEST, resume=True)).total_steps == 1
    assert "made by symgrasp 0.0.5" in caplog.text


def test_the_picture_of_a_resumed_run_equals_that_of_an_uninterrupted_one(tmp_path, whole):
    output = tmp_path / "line.safetensors"
    run = new_run(output, Line())
    stop_after(run, 20)  # the end of an epoch
    run.run()
    trained(output, resume=True)
    assert file_of_run(output, CURVES).read_bytes() == file_of_run(whole[Line], CURVES).read_bytes()


def test_generators_of_different_places_draw_different_numbers():
    drawn = [generator(*each).random() for each in ((0, 1), (0, 1, 0), (1, 0), (0, 1, 0, 0))]
    assert len(set(drawn)) == 4
