"""The critics in numpy say what the same layers say in torch, and give probabilities."""

import numpy as np
import pytest
import torch

from pipelines.errors import FormatError
from pipelines.grasping.candidates import mirror_views
from pipelines.grasping.candidates.plane_evidence import FEATURES
from pipelines.grasping.ranking import critic_files, grasp_features
from pipelines.inference.models import GRASP_CRITIC_WEIGHTS, PLANE_CRITIC_WEIGHTS
from pipelines.storage.checkpoints import load_weights, save_weights

CRITICS = {  # weights, what they are of, and widths of points, wholes and evidence
    "planes": (
        PLANE_CRITIC_WEIGHTS,
        critic_files.PLANES,
        (mirror_views.POINT_FEATURES, mirror_views.PLANE_FEATURES, len(FEATURES)),
    ),
    "hands": (
        GRASP_CRITIC_WEIGHTS,
        critic_files.GRASPS,
        (grasp_features.POINT_FEATURES, 0, grasp_features.GRASP_FEATURES),
    ),
}


def inputs(widths, count=5, points=16):
    rng = np.random.default_rng(0)
    shapes = ((count, points, widths[0]), (count, widths[1]), (count, widths[2]))
    return [rng.normal(size=shape).astype(np.float32) for shape in shapes]


def through(tensors, name, features):
    for index in range(3):
        features = torch.relu(features) if index else features
        weight, bias = (tensors[f"{name}.{index}.{part}"] for part in ("weight", "bias"))
        features = torch.nn.functional.linear(features, weight, bias)
    return features


@pytest.fixture(params=CRITICS)
def critic(request):
    path, model, widths = CRITICS[request.param]
    return path, critic_files.read(path, model), widths


def test_the_default_judges_are_what_their_layers_are_in_torch(critic):
    path, network, widths = critic
    tensors, _ = load_weights(path)
    points, wholes, evidence = (torch.from_numpy(each) for each in inputs(widths))
    around = wholes[:, None].expand(-1, points.shape[1], -1)
    hidden = through(tensors, "point", torch.cat([points, around], -1))
    known = (evidence - tensors["mean"]) / tensors["spread"]
    joined = torch.cat([hidden.amax(1), hidden.mean(1), known, wholes], -1)
    expected = through(tensors, "last", joined)[:, 0]
    found = network.logits(*inputs(widths))
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-4, atol=1e-4)


def test_the_order_of_points_says_nothing(critic):
    _, network, widths = critic
    points, wholes, evidence = inputs(widths)
    mixed = points[:, np.random.default_rng(1).permutation(points.shape[1])]
    here, there = (network.logits(each, wholes, evidence) for each in (points, mixed))
    np.testing.assert_allclose(here, there, rtol=1e-4, atol=1e-4)


def test_trust_is_a_probability_in_the_order_of_the_logits(critic):
    _, network, widths = critic
    logits, trust = network.logits(*inputs(widths, 40)), network.trust(*inputs(widths, 40))
    assert ((trust >= 0) & (trust <= 1)).all()
    assert (np.diff(trust[np.argsort(logits)]) >= 0).all()
    assert trust.max() > trust.min()


def test_nothing_is_said_of_no_candidates(critic):
    _, network, widths = critic
    assert network.trust(*inputs(widths, 0)).shape == (0,)


def test_other_weights_are_refused_by_name(tmp_path):
    path = tmp_path / "other.safetensors"
    save_weights(path, {"a": torch.zeros(1)}, {"model": "SymmetryGraspNet"})
    with pytest.raises(FormatError, match="holds SymmetryGraspNet"):
        critic_files.read(path, critic_files.PLANES)
    with pytest.raises(FormatError, match="holds PlaneCritic; weights of GraspCritic"):
        critic_files.read(PLANE_CRITIC_WEIGHTS, critic_files.GRASPS)
    save_weights(path, {"a": torch.zeros(1)}, {"model": critic_files.PLANES})
    with pytest.raises(FormatError, match=r"has no point\.0\.weight"):
        critic_files.read(path, critic_files.PLANES)


def test_weights_for_other_numbers_are_refused_with_how_many(tmp_path):
    path = tmp_path / "other.safetensors"
    tensors, _ = load_weights(PLANE_CRITIC_WEIGHTS)
    tensors["mean"] = tensors["mean"][:-1].clone()
    save_weights(path, tensors, {"model": critic_files.PLANES})
    with pytest.raises(FormatError, match="takes 17 numbers of a point and 8, not 17 and 9"):
        critic_files.read(path, critic_files.PLANES)
