"""The judge in numpy says what the same layers say in torch, and gives probabilities."""

import numpy as np
import pytest
import torch

from pipelines.errors import FormatError
from pipelines.formats import plane_judge_file
from pipelines.formats.checkpoints import load_weights, save_weights
from pipelines.grasping.mirror_views import PLANE_FEATURES, POINT_FEATURES
from pipelines.grasping.plane_evidence import FEATURES
from pipelines.inference.models import PLANE_WEIGHTS


def inputs(count=5, points=16):
    rng = np.random.default_rng(0)
    shapes = ((count, points, POINT_FEATURES), (count, PLANE_FEATURES), (count, len(FEATURES)))
    return [rng.normal(size=shape).astype(np.float32) for shape in shapes]


def through(tensors, name, features):
    for index in range(3):
        features = torch.relu(features) if index else features
        weight, bias = (tensors[f"{name}.{index}.{part}"] for part in ("weight", "bias"))
        features = torch.nn.functional.linear(features, weight, bias)
    return features


def test_the_default_judge_is_what_its_layers_are_in_torch():
    tensors, _ = load_weights(PLANE_WEIGHTS)
    points, planes, evidence = (torch.from_numpy(each) for each in inputs())
    around = planes[:, None].expand(-1, points.shape[1], -1)
    hidden = through(tensors, "point", torch.cat([points, around], -1))
    known = (evidence - tensors["mean"]) / tensors["spread"]
    joined = torch.cat([hidden.amax(1), hidden.mean(1), known, planes], -1)
    expected = through(tensors, "plane", joined)[:, 0]
    found = plane_judge_file.read(PLANE_WEIGHTS).logits(*inputs())
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-4, atol=1e-4)


def test_the_order_of_points_says_nothing():
    judge, (points, planes, evidence) = plane_judge_file.read(PLANE_WEIGHTS), inputs()
    mixed = points[:, np.random.default_rng(1).permutation(points.shape[1])]
    here, there = (judge.logits(each, planes, evidence) for each in (points, mixed))
    np.testing.assert_allclose(here, there, rtol=1e-4, atol=1e-4)


def test_trust_is_a_probability_in_the_order_of_the_logits():
    judge = plane_judge_file.read(PLANE_WEIGHTS)
    logits, trust = judge.logits(*inputs(40)), judge.trust(*inputs(40))
    assert ((trust >= 0) & (trust <= 1)).all()
    assert (np.diff(trust[np.argsort(logits)]) >= 0).all()
    assert trust.max() > 0.5 > trust.min()


def test_other_weights_are_refused_by_name(tmp_path):
    path = tmp_path / "other.safetensors"
    save_weights(path, {"a": torch.zeros(1)}, {"model": "SymmetryGraspNet"})
    with pytest.raises(FormatError, match="holds SymmetryGraspNet"):
        plane_judge_file.read(path)
    save_weights(path, {"a": torch.zeros(1)}, {"model": plane_judge_file.MODEL})
    with pytest.raises(FormatError, match=r"has no point\.0\.weight"):
        plane_judge_file.read(path)
