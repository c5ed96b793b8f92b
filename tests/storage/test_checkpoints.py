"""Weights and training checkpoints as safetensors."""

from pathlib import Path

import pytest

from pipelines.errors import FormatError
from pipelines.storage import checkpoints
from pipelines.storage.checkpoints import TrainingState
from pipelines.storage.provenance import is_finished, make_stamp

torch = pytest.importorskip("torch")
STAMP = make_stamp("train", {"epochs": 2}, seed=7)


def trained(model: "torch.nn.Module", steps: int) -> "torch.optim.Optimizer":
    optimizer = torch.optim.Adam(model.parameters(), lr=0.01)
    for _ in range(steps):
        step(model, optimizer)
    return optimizer


def step(model: "torch.nn.Module", optimizer: "torch.optim.Optimizer") -> None:
    optimizer.zero_grad()
    model(torch.rand(4, 3)).square().sum().backward()
    optimizer.step()


def test_weights_come_back_with_their_metadata(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    made = {"a": torch.arange(6.0).reshape(2, 3).T, "b": torch.tensor(3)}
    checkpoints.save_weights(path, made, {"config": "{}"}, STAMP)
    tensors, metadata = checkpoints.load_weights(path)
    assert torch.equal(tensors["a"], made["a"])
    assert tensors["b"].item() == 3
    assert metadata["config"] == "{}"
    assert is_finished(path, STAMP)


def test_the_same_weights_give_the_same_bytes(tmp_path: Path) -> None:
    metadata = {letter: letter for letter in "gfedcba"}
    for name in ("a", "b", "c"):
        checkpoints.save_weights(tmp_path / name, {"x": torch.ones(3)}, metadata)
    assert len({(tmp_path / name).read_bytes() for name in ("a", "b", "c")}) == 1


def test_shared_tensors_are_stored_separately(tmp_path: Path) -> None:
    tensor = torch.ones(4)
    checkpoints.save_weights(tmp_path / "w.safetensors", {"a": tensor, "b": tensor[:2]}, {})
    tensors, _ = checkpoints.load_weights(tmp_path / "w.safetensors")
    assert tensors["b"].shape == (2,)


def test_a_resumed_training_takes_the_same_steps(tmp_path: Path) -> None:
    torch.manual_seed(0)
    model = torch.nn.Linear(3, 2)
    optimizer = trained(model, 3)
    state = TrainingState(
        model=model.state_dict(),
        optimizer=optimizer.state_dict(),
        progress={"epoch": 1, "losses": [0.5, 0.25]},
    )
    checkpoints.save_training(tmp_path / "c.safetensors", state, STAMP)
    torch.manual_seed(1)
    step(model, optimizer)

    again = checkpoints.load_training(tmp_path / "c.safetensors")
    assert again.progress == {"epoch": 1, "losses": [0.5, 0.25]}
    other = torch.nn.Linear(3, 2)
    other.load_state_dict(again.model)
    resumed = torch.optim.Adam(other.parameters())
    resumed.load_state_dict(again.optimizer)
    torch.manual_seed(1)
    step(other, resumed)
    assert torch.equal(model.weight, other.weight)


@pytest.mark.parametrize("kept", [0, 5, 40])
def test_truncated_weights_are_reported_in_one_sentence(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "w.safetensors"
    checkpoints.save_weights(path, {"x": torch.ones(30)}, {"a": "b"})
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(FormatError, match=r"w\.safetensors"):
        checkpoints.load_weights(path)


def test_weights_are_refused_as_training_checkpoint(tmp_path: Path) -> None:
    checkpoints.save_weights(tmp_path / "w.safetensors", {"x": torch.ones(3)}, {})
    with pytest.raises(FormatError, match="weights only"):
        checkpoints.load_training(tmp_path / "w.safetensors")
