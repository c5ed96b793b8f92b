"""The trained network as a function."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.configs import NetworkConfig
from pipelines.errors import FormatError, UnknownNameError, ValueRangeError
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import random_rotation, unit
from pipelines.inference.models import NETWORK_WEIGHTS
from pipelines.network.model import Prediction, SymmetryGraspNet
from pipelines.network.predictor import GraspPredictor
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import save_weights

CONFIG = NetworkConfig(num_points=200, set_points=(64, 32, 16, 4), set_neighbors=(8, 8, 8, 16))


def random_weights(path, config):
    torch.manual_seed(0)
    network = SymmetryGraspNet(config)
    save_weights(path, network.state_dict(), weights_metadata("SymmetryGraspNet", config))
    return path


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return random_weights(tmp_path_factory.mktemp("weights") / "network.safetensors", CONFIG)


@pytest.fixture(scope="module")
def predictor(weights):
    return GraspPredictor.load(weights, "cpu")


@pytest.mark.parametrize("default", [torch.float64, torch.float16])
def test_weights_are_read_in_single_precision_whatever_torchs_default_is(
    predictor, weights, default
):
    torch.set_default_dtype(default)
    try:
        loaded = GraspPredictor.load(weights, "cpu")
        (found,) = loaded.predict([cloud(300)])
        assert torch.get_default_dtype() == default
    finally:
        torch.set_default_dtype(torch.float32)
    (expected,) = predictor.predict([cloud(300)])
    assert_array_equal(found.affordance, expected.affordance)
    assert_array_equal(found.direction, expected.direction)


def cloud(count, seed=0):
    return np.random.default_rng(seed).normal((0.1, -0.2, 0.7), 0.03, (count, 3))


def test_shapes_and_ranges_are_as_documented(predictor):
    for prediction in predictor.predict([cloud(500), cloud(50, 1)]):
        assert prediction.index.shape == (200,)
        assert prediction.affordance.shape == (200,)
        assert prediction.center.shape == prediction.direction.shape == (67, 5, 3)
        assert prediction.existence.shape == (67, 5)
        assert ((prediction.affordance >= 0) & (prediction.affordance <= 1)).all()
        assert_allclose(np.linalg.norm(prediction.direction[:, :4], axis=-1), 1.0, rtol=1e-5)


@pytest.mark.parametrize(("count", "distinct"), [(300, 200), (200, 200), (150, 150)])
def test_points_are_repeated_only_where_there_are_too_few(predictor, count, distinct):
    (prediction,) = predictor.predict([cloud(count)])
    assert len(set(prediction.index)) == distinct
    assert set(prediction.index) <= set(range(count))


def test_the_network_is_told_where_the_camera_is(predictor, monkeypatch):
    points, told = cloud(300), []
    outputs = GraspPredictor._outputs

    def noted(self, *seen):
        told.extend(seen)
        return outputs(self, *seen)

    monkeypatch.setattr(GraspPredictor, "_outputs", noted)
    table = Plane(unit([0.0, -1.0, -1.0]), 0.6)
    (prediction,) = predictor.predict([points], table)
    seen, ground, camera = told[:3]
    away = np.linalg.norm(points[prediction.index], axis=1)  # the camera is at the origin
    assert_allclose(np.linalg.norm(seen[0] - camera[0], axis=1), away, rtol=1e-5)
    assert_allclose(ground + seen[0, :, 2], table.height(points[prediction.index]), atol=1e-6)


@pytest.mark.parametrize("count", [150, 300])
def test_the_network_sees_points_in_random_order(predictor, count):
    (prediction,) = predictor.predict([cloud(count)])
    order = np.corrcoef(prediction.index, np.arange(len(prediction.index)))[0, 1]
    assert abs(order) < 0.3


class Echo(torch.nn.Module):
    """Predicts the depth of each point as its affordance."""

    def forward(self, points, ground, stride, camera):
        voting = points[:, ::stride]
        center, existence = (
            voting[:, :, None].repeat(1, 1, 5, 1),
            torch.zeros(*voting.shape[:2], 5),
        )
        return Prediction(points, 0.5 + points[..., 2], existence, center, center)


def test_predictions_belong_to_the_points_of_their_indices():
    region = cloud(300)
    echo = GraspPredictor(Echo(), replace(CONFIG, input_frame="camera"), torch.device("cpu"))
    (prediction,) = echo.predict([region])
    depth = region[prediction.index, 2]
    assert_allclose(prediction.affordance, 0.5 + depth - depth.mean(), atol=1e-6)
    assert_allclose(prediction.center[:, 2], region[prediction.index][::3], atol=1e-6)


def test_moving_a_region_away_moves_its_symmetries(tmp_path):
    # From farther away, the directions to the camera change; this network does not see them.
    config = replace(CONFIG, sees_camera=False)
    predictor = GraspPredictor.load(random_weights(tmp_path / "n.safetensors", config), "cpu")
    region = cloud(200)
    shift = 0.3 * region.mean(0)  # a shift sideways would show another side
    (here,), (there,) = predictor.predict([region]), predictor.predict([region + shift])
    assert_allclose(there.center, here.center + shift, atol=2e-3)
    assert_allclose(there.affordance, here.affordance, atol=2e-2)


@pytest.mark.parametrize("seed", range(3))
def test_turning_the_camera_turns_the_symmetries(predictor, seed):
    turn = random_rotation(np.random.default_rng(seed))
    region, table = cloud(200, seed), Plane(unit(np.array([0.1, -0.8, -0.5])), 0.5)
    (here,) = predictor.predict([region], table)
    (there,) = predictor.predict([region @ turn.T], Plane(turn @ table.normal, table.offset))
    assert_allclose(there.center, here.center @ turn.T, atol=2e-3)
    assert_allclose(there.affordance, here.affordance, atol=2e-2)
    signs = np.sign(np.sum(there.direction * (here.direction @ turn.T), -1, keepdims=True))
    assert_allclose(there.direction, signs * (here.direction @ turn.T), atol=2e-2)


def test_predictions_depend_on_the_height_above_the_table(predictor):
    region, table = cloud(200), Plane(unit(np.array([0.1, -0.8, -0.5])), 0.5)
    (low,) = predictor.predict([region], table)
    (high,) = predictor.predict([region], Plane(table.normal, table.offset + 0.3))
    assert np.abs(high.center - low.center).max() > 1e-3


def test_a_region_gets_equal_predictions_alone_in_a_batch_and_with_any_threads():
    predictor = GraspPredictor.load(NETWORK_WEIGHTS, "cpu")  # untrained weights hardly deform
    regions = [cloud(count, count) for count in (300, 80, 1600, 2500, 40)]
    alone = [predictor.predict([region])[0] for region in regions]
    threads = torch.get_num_threads()
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            for company in (regions, regions[::-1], regions[1:4]):
                for region, found in zip(company, predictor.predict(company), strict=True):
                    (expected,) = [a for r, a in zip(regions, alone, strict=True) if r is region]
                    for name in ("index", "affordance", "existence", "center", "direction"):
                        assert_array_equal(getattr(found, name), getattr(expected, name))
            assert torch.get_num_threads() == count
    finally:
        torch.set_num_threads(threads)


def test_the_same_input_gives_the_same_bytes(predictor):
    first, second = (predictor.predict([cloud(300)])[0] for _ in range(2))
    assert first.center.tobytes() == second.center.tobytes()


def test_no_regions_give_no_predictions(predictor):
    assert predictor.predict([]) == []


@pytest.mark.parametrize("bad", [np.zeros((0, 3)), np.zeros((4, 2)), np.full((4, 3), np.nan)])
def test_wrong_regions_are_refused(predictor, bad):
    with pytest.raises(ValueRangeError):
        predictor.predict([bad])


def test_weights_of_another_model_are_refused(tmp_path):
    path = tmp_path / "other.safetensors"
    save_weights(path, {"a": torch.zeros(2)}, {"model": "Other"})
    with pytest.raises(FormatError, match="holds Other"):
        GraspPredictor.load(path, "cpu")


def test_weights_that_lack_a_setting_are_refused(tmp_path):
    path = tmp_path / "earlier.safetensors"
    settings = json.loads(weights_metadata("SymmetryGraspNet", CONFIG)["config"])
    del settings["canonical_frame"]
    metadata = {"model": "SymmetryGraspNet", "config": json.dumps(settings)}
    save_weights(path, SymmetryGraspNet(CONFIG).state_dict(), metadata)
    with pytest.raises(FormatError, match="lacks the settings canonical_frame"):
        GraspPredictor.load(path, "cpu")


def test_weights_with_an_unknown_setting_are_refused(tmp_path):
    path = tmp_path / "later.safetensors"
    settings = json.loads(weights_metadata("SymmetryGraspNet", CONFIG)["config"])
    metadata = {"model": "SymmetryGraspNet", "config": json.dumps({**settings, "use_pifts": 1})}
    save_weights(path, SymmetryGraspNet(CONFIG).state_dict(), metadata)
    with pytest.raises(UnknownNameError, match="'use_pifts' is not known, the nearest is"):
        GraspPredictor.load(path, "cpu")


def test_weights_that_do_not_fit_are_refused(tmp_path):
    path = tmp_path / "torn.safetensors"
    metadata = weights_metadata("SymmetryGraspNet", CONFIG)
    save_weights(path, {"a": torch.zeros(2)}, metadata)
    with pytest.raises(FormatError, match="do not fit"):
        GraspPredictor.load(path, "cpu")
