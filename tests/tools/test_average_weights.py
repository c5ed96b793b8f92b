"""The mean of the weights of several networks."""

import numpy as np
import pytest
import torch

from pipelines.errors import SymgraspError
from pipelines.inference.models import PLANE_CRITIC_WEIGHTS
from pipelines.storage.checkpoints import load_arrays, load_weights, save_weights
from tools.average_weights import average_weights


def test_weights_are_averaged_and_counts_and_description_kept(tmp_path):
    paths = [tmp_path / f"{name}.safetensors" for name in "ab"]
    for number, path in enumerate(paths):
        tensors = {"layer": torch.full((2, 2), 1.0 + 2 * number), "steps": torch.tensor(number)}
        save_weights(path, tensors, {"model": "M", "provenance": str(number)})
    average_weights(paths, tmp_path / "mean.safetensors")
    tensors, metadata = load_arrays(tmp_path / "mean.safetensors")
    assert (tensors["layer"] == 2.0).all()
    assert tensors["steps"] == 0
    assert metadata == {"model": "M"}


def test_the_mean_of_the_same_weights_is_these_weights(tmp_path):
    out = tmp_path / "mean.safetensors"
    average_weights([PLANE_CRITIC_WEIGHTS] * 3, out)
    mean, before = load_arrays(out)[0], load_arrays(PLANE_CRITIC_WEIGHTS)[0]
    assert mean.keys() == before.keys()
    assert all(np.array_equal(mean[name], before[name]) for name in before)


def test_networks_of_another_kind_are_refused(tmp_path):
    other = tmp_path / "other.safetensors"
    tensors, metadata = load_weights(PLANE_CRITIC_WEIGHTS)
    save_weights(other, tensors, metadata | {"features": "{}"})
    with pytest.raises(SymgraspError, match=r"other\.safetensors holds a network of another kind"):
        average_weights([PLANE_CRITIC_WEIGHTS, other], tmp_path / "mean.safetensors")
    assert not (tmp_path / "mean.safetensors").exists()
