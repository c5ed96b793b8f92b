"""Weights of critics are opened only if they name the features that the code computes."""

import json

import pytest
import torch

from pipelines.errors import FormatError
from pipelines.grasping.critics import critic_files
from pipelines.grasping.critics.critic_files import PLANES
from pipelines.inference import models
from pipelines.storage.checkpoints import load_weights, save_weights

SHIPPED = {
    critic_files.AXES: models.AXIS_CRITIC_WEIGHTS,
    PLANES: models.PLANE_CRITIC_WEIGHTS,
    critic_files.GRASPS: models.GRASP_CRITIC_WEIGHTS,
}


def changed(path, model, tensors=None, **metadata):
    """Write the shipped weights of `model` with other tensors or metadata."""
    own, stored = load_weights(SHIPPED[model])
    stored = {name: text for name, text in {**stored, **metadata}.items() if text is not None}
    save_weights(path, {**own, **(tensors or {})}, stored)
    return path


@pytest.mark.parametrize("model", SHIPPED)
def test_the_shipped_files_name_the_features_that_are_computed(model):
    critic_files.read_point_critic(SHIPPED[model], model)
    _, metadata = load_weights(SHIPPED[model])
    named = json.loads(metadata["features"])
    assert {name: tuple(each) for name, each in named.items()} == vars(critic_files.FEATURES[model])


@pytest.mark.parametrize("model", SHIPPED)
def test_a_feature_of_another_name_is_refused_with_the_command_that_makes_the_file(tmp_path, model):
    names = {group: list(each) for group, each in vars(critic_files.FEATURES[model]).items()}
    names["candidate"][1:3] = names["candidate"][2:0:-1]
    path = changed(tmp_path / "x.safetensors", model, features=json.dumps(names))
    first, second = critic_files.FEATURES[model].candidate[1:3]
    message = (
        f"takes {second} as candidate feature 2, where {first} is computed; make the file again"
    )
    with pytest.raises(FormatError, match=f"{message} with `symgrasp train-critic "):
        critic_files.read_point_critic(path, model)


def test_another_number_of_features_none_or_no_json_is_refused(tmp_path):
    model, path = PLANES, tmp_path / "x.safetensors"
    names = vars(critic_files.FEATURES[model])
    fewer = json.dumps({**names, "point": names["point"][1:]})
    with pytest.raises(FormatError, match="takes 13 point features, not 14"):
        critic_files.read_point_critic(changed(path, model, features=fewer), model)
    with pytest.raises(FormatError, match="does not name its point features"):
        critic_files.read_point_critic(changed(path, model, features=None), model)
    with pytest.raises(FormatError, match="no JSON object"):
        critic_files.read_point_critic(changed(path, model, features="[1, 2]"), model)


def test_other_weights_are_refused_by_name(tmp_path):
    path = tmp_path / "other.safetensors"
    save_weights(path, {"a": torch.zeros(1)}, {"model": "SymmetryGraspNet"})
    with pytest.raises(FormatError, match="holds SymmetryGraspNet"):
        critic_files.read_point_critic(path, PLANES)
    with pytest.raises(FormatError, match="holds PlaneCritic; weights of GraspCritic"):
        critic_files.read_point_critic(models.PLANE_CRITIC_WEIGHTS, critic_files.GRASPS)
    save_weights(path, {"a": torch.zeros(1)}, critic_files.metadata_of(PLANES))
    with pytest.raises(FormatError, match=r"point\.0\.weight is not there"):
        critic_files.read_point_critic(path, PLANES)


def test_tensors_of_another_shape_are_refused(tmp_path):
    path = tmp_path / "other.safetensors"
    mean = load_weights(models.PLANE_CRITIC_WEIGHTS)[0]["mean"][:-1].clone()
    with pytest.raises(FormatError, match=r"mean is \(8,\); shape \(9,\) is expected"):
        critic_files.read_point_critic(changed(path, PLANES, {"mean": mean}), PLANES)
