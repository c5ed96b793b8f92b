"""Trainings in separate processes: two that share every batch, one that is killed."""

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch.distributed import run as torchrun

from pipelines import train
from pipelines.configs import TrainConfig
from pipelines.ending import signal_handlers_kept
from pipelines.errors import ValueRangeError
from pipelines.learning.loop.runs import CHECKPOINT, RunRequest, file_of_run
from pipelines.learning.speed.micro_batches import micro_batch_size, micro_batches_of
from pipelines.learning.speed.processes import Processes, process_group
from pipelines.storage.checkpoints import load_weights
from tests.learning.packed_toys import CONFIG, write_packed

ROOT = Path(__file__).resolve().parents[3]
TOYS = ("-m", "tests.learning.train_toys")
REQUEST = RunRequest(device="cpu", threads=1)
TWO = ("--standalone", "--nproc-per-node", "2")


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    return write_packed(tmp_path_factory.mktemp("packed"))


@pytest.fixture(scope="module")
def alone(packed, tmp_path_factory):
    """The weights of one process that is not interrupted."""
    path = tmp_path_factory.mktemp("alone") / "network.safetensors"
    train.run(packed, None, path, CONFIG, REQUEST)
    return path


@pytest.fixture(autouse=True)
def surroundings(monkeypatch):
    """The working folder and environment of a training in a separate process."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def test_two_processes_give_the_weights_of_one(packed, alone, tmp_path):
    output = tmp_path / "network.safetensors"
    with signal_handlers_kept():  # torchrun in this process: torch is loaded already
        torchrun.main([*TWO, *TOYS, str(packed), str(output)])  # raises the error of a process
    expected, found = load_weights(alone)[0], load_weights(output)[0]
    for name, tensor in expected.items():
        torch.testing.assert_close(found[name], tensor, rtol=1e-4, atol=1e-5)
    logs = list((tmp_path / "network.logs").iterdir())
    assert len(logs) == 1  # only the first process writes


def test_a_run_killed_within_a_step_and_resumed_gives_the_same_bytes(packed, alone, tmp_path):
    output = tmp_path / "network.safetensors"
    command = [sys.executable, *TOYS, packed, output, "--die-at", "6"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert file_of_run(output, CHECKPOINT).exists()
    train.run(packed, None, output, CONFIG, replace(REQUEST, resume=True))
    assert output.read_bytes() == alone.read_bytes()


def test_one_gpu_is_not_given_to_several_processes(monkeypatch):
    for name, value in (("TORCHELASTIC_RUN_ID", "0"), ("LOCAL_WORLD_SIZE", "2")):
        monkeypatch.setenv(name, value)
    with (
        pytest.raises(ValueRangeError, match="cuda:0; it must be cuda, which"),
        process_group("cuda:0"),
    ):
        pass


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_processes_share_a_batch_without_remainder(count):
    shares = [micro_batches_of(list(range(10)), 3, Processes(rank, count)) for rank in range(count)]
    pieces = [piece for each in shares for piece in each if piece.share]
    assert sorted(item for piece in pieces for item in piece.items) == list(range(10))
    assert sum(piece.share for piece in pieces) == pytest.approx(1.0)
    alone = {
        piece.number: piece.items for piece in micro_batches_of(list(range(10)), 3, Processes())
    }
    assert {piece.number: piece.items for piece in pieces} == alone


def test_a_process_without_a_part_of_a_short_batch_adds_nothing():
    (idle,) = micro_batches_of([0, 1], 2, Processes(1, 2))
    assert idle.share == 0.0


def batches_of(size: int, micro: int = 0) -> TrainConfig:
    return TrainConfig(batch_size=size, micro_batch_size=micro)


def test_processes_that_cannot_share_evenly_are_refused():
    with pytest.raises(ValueRangeError, match="6; it must be a multiple of the 4 processes"):
        micro_batch_size(batches_of(36), 6, Processes(0, 4))
    assert micro_batch_size(batches_of(36), 6, Processes(0, 3)) == 6


def test_micro_batches_are_small_on_a_cpu_and_the_whole_share_on_a_gpu():
    assert micro_batch_size(batches_of(36), 6, Processes(0, 2)) == 6
    assert micro_batch_size(batches_of(36), 0, Processes(0, 2)) == 18
    assert micro_batch_size(batches_of(36, 9), 0, Processes(0, 2)) == 9
    assert micro_batch_size(batches_of(4), 6, Processes()) == 4
