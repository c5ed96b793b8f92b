"""Figures of predictions whose quality is known."""

from dataclasses import replace

import pytest
import torch

from pipelines.learning.grasp_network.region_figures import RegionFigures, area_under_roc
from pipelines.network.model import Prediction
from tests.network.test_losses import perfect_prediction
from tests.network.toy_regions import toy_batch


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
