"""The mean of the weights of several networks."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines.configs import NetworkConfig
from pipelines.errors import SymgraspError
from pipelines.inference.models import PLANE_CRITIC_WEIGHTS
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import weights_metadata
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


def test_weights_of_an_earlier_version_are_averaged_with_new_ones(tmp_path):
    torch.manual_seed(0)
    blind = replace(NetworkConfig(), sees_camera=False)
    tensors = SymmetryGraspNet(blind).state_dict()
    before, further, out = (tmp_path / f"{name}.safetensors" for name in ("a", "b", "mean"))
    metadata = weights_metadata("SymmetryGraspNet", blind)
    unnamed = json.loads(metadata["config"])
    del unnamed["sees_camera"]  # earlier versions did not have the setting
    save_weights(before, tensors, {**metadata, "config": json.dumps(unnamed)})
    save_weights(further, tensors, metadata)
    average_weights([before, further], out)
    assert json.loads(load_weights(out)[1]["config"]) == unnamed
    save_weights(further, tensors, weights_metadata("SymmetryGraspNet", NetworkConfig()))
    with pytest.raises(SymgraspError, match="holds a network of another kind"):
        average_weights([before, further], out)


def test_a_checkpoint_is_refused(tmp_path):
    path = tmp_path / "n.checkpoint.safetensors"
    save_weights(path, {"model.x": torch.zeros(1)}, {"progress": "{}"})
    with pytest.raises(SymgraspError, match=r"n\.checkpoint\.safetensors holds no network"):
        average_weights([path, path], tmp_path / "mean.safetensors")


def test_networks_of_another_kind_are_refused(tmp_path):
    other = tmp_path / "other.safetensors"
    tensors, metadata = load_weights(PLANE_CRITIC_WEIGHTS)
    save_weights(other, tensors, metadata | {"features": "{}"})
    with pytest.raises(SymgraspError, match=r"other\.safetensors holds a network of another kind"):
        average_weights([PLANE_CRITIC_WEIGHTS, other], tmp_path / "mean.safetensors")
    assert not (tmp_path / "mean.safetensors").exists()
