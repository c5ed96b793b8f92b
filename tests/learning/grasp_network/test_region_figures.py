"""Figures of predictions whose quality is known."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from pipelines.configs import NetworkConfig
from pipelines.grasping.scene import RegionCloud
from pipelines.inference.regions.predicted_regions import predicted_regions
from pipelines.learning.grasp_network.region_figures import (
    RegionFigures,
    area_under_roc,
    mean_symmetries,
)
from pipelines.network.model import Prediction, SymmetryGraspNet
from pipelines.network.predictor import GraspPredictor
from tests.network.toy_regions import toy_batch
from tests.network.training.test_losses import perfect_prediction


def test_a_perfect_prediction_has_perfect_figures():
    truth, figures = toy_batch(6, 64), RegionFigures()
    figures.add(perfect_prediction(truth), truth)
    got = figures.figures()
    assert got["affordance_mae"] == pytest.approx(0.0)
    assert got["affordance_auc"] == pytest.approx(1.0)
    assert got["existence_accuracy"] == pytest.approx(1.0)
    for name in ("plane_angle_deg", "axis_angle_deg", "sphere_offset_m", "plane_dense_error"):
        assert got[name] == pytest.approx(0.0, abs=0.1)
    assert got["planes_found"] == 1.0


def test_a_plane_far_off_counts_as_not_found():
    truth, figures = toy_batch(1, 64), RegionFigures()  # a box: three planes
    perfect = perfect_prediction(truth)
    center = perfect.center.clone()
    center[:, :, 0] += 0.2 * truth.direction[:, None, 0]
    figures.add(replace(perfect, center=center), truth)
    assert figures.figures()["planes_found"] == pytest.approx(2 / 3)


def test_the_figures_are_of_the_symmetries_that_infer_proposes():
    torch.manual_seed(0)
    config = NetworkConfig(
        input_frame="camera", num_points=200, set_points=(64, 32, 16, 4), set_neighbors=(8,) * 4
    )
    predictor = GraspPredictor(SymmetryGraspNet(config).eval(), config, torch.device("cpu"))
    points = np.random.default_rng(0).normal((0.1, -0.2, 0.7), (0.02, 0.03, 0.05), (300, 3))
    cloud = RegionCloud(points, np.ones_like(points), np.ones((1, 1), np.bool_))
    (region,) = predicted_regions([cloud], None, predictor)
    middle = region.cloud.points.mean(0)
    centered = torch.from_numpy(region.cloud.points - middle).float()[None]
    camera = torch.from_numpy(-middle).float()[None]
    with torch.no_grad():  # at all points, as in the training
        means = mean_symmetries(predictor.network(centered, camera=camera))
    existence, point, direction = (each[0].numpy() for each in means)
    assert_allclose(existence, region.slots.probability, atol=1e-5)
    assert_allclose(point + middle, region.slots.point, atol=1e-5)
    assert_allclose(direction, region.slots.direction, atol=1e-4)


def test_the_figures_do_not_weigh_a_point_by_its_affordance():
    truth, figures = toy_batch(3, 60), RegionFigures()  # the last one is a ball
    perfect = perfect_prediction(truth)
    affordance, center = torch.zeros_like(perfect.affordance), perfect.center.clone()
    affordance[:, ::2] = 1.0
    center[:, ::2, :, 0] += 0.01
    figures.add(replace(perfect, affordance=affordance, center=center), truth)
    assert figures.figures()["sphere_offset_m"] == pytest.approx(0.005)


def test_the_area_counts_how_often_a_positive_is_above_a_negative():
    values = torch.tensor([0.9, 0.6, 0.4, 0.1])
    assert area_under_roc(values, torch.tensor([True, False, True, False])) == pytest.approx(0.75)
    assert area_under_roc(values, torch.zeros(4, dtype=torch.bool)) == 0.5


def test_the_area_is_a_half_where_all_values_are_equal():
    for positive in ([True, True, False, False], [False, False, True, True]):
        assert area_under_roc(torch.full((4,), 0.8), torch.tensor(positive)) == 0.5


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_figures_of_tensors_on_a_gpu_equal_those_on_the_cpu():
    truth, sums = toy_batch(6, 64), []
    perfect = perfect_prediction(truth)
    for device in ("cpu", "cuda"):
        figures, there = RegionFigures(), torch.device(device)
        moved = Prediction(**{name: each.to(there) for name, each in vars(perfect).items()})
        figures.add(moved, truth.to(there))
        sums.append(figures.figures())
    assert sums[1] == pytest.approx(sums[0], abs=1e-3)
