"""Average precision of masks."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.dataset.training.region_frames import FrameSets
from pipelines.learning.detector import detector_training
from pipelines.learning.detector.detector_training import DetectorTraining, mask_figures


def square(x, size=10):
    mask = np.zeros((40, 60), bool)
    mask[10 : 10 + size, x : x + size] = True
    return mask


def test_equal_masks_give_an_average_precision_of_one():
    masks = np.stack([square(5), square(30)])
    assert mask_figures([(masks, masks, np.array([0.9, 0.8]))])["mask_ap50"] == pytest.approx(1.0)


def test_a_missed_region_halves_recall_and_a_confident_false_one_costs_precision():
    truth, found = np.stack([square(5), square(30)]), np.stack([square(45), square(5)])
    got = mask_figures([(truth, found, np.array([0.9, 0.8]))])
    assert got["mask_recall50"] == pytest.approx(0.5)
    assert got["mask_ap50"] == pytest.approx(0.25, abs=0.01)


def test_all_figures_are_zero_without_predictions():
    nothing = np.zeros((0, 40, 60), bool), np.zeros(0)
    assert mask_figures([(np.stack([square(5)]), *nothing)])["mask_ap50"] == 0.0


class HalfSure(torch.nn.Module):
    """Finds one region of 40 x 60 pixels: its left half with probability 0.9, the other 0.6."""

    def forward(self, images):
        soft = torch.full((1, 1, 28, 28), 0.6)
        soft[..., :14] = 0.9
        box = torch.tensor([[0.0, 0.0, 60.0, 40.0]])
        return [{"masks": soft, "boxes": box, "scores": torch.ones(1)}]


@pytest.mark.parametrize(("threshold", "precision"), [(0.75, 1.0), (0.55, 0.0)])
def test_masks_are_validated_with_the_threshold_of_the_detector(threshold, precision, monkeypatch):
    view = SimpleNamespace(regions=np.zeros((40, 60), np.uint8))
    view.regions[:, :30] = 1
    reader = SimpleNamespace(read=lambda path, row: view)
    example = SimpleNamespace(image=torch.zeros(3, 40, 60))
    monkeypatch.setattr(detector_training, "detector_frames", reader)
    monkeypatch.setattr(detector_training, "as_example", lambda view, kind: example)
    config = FinetuneDetectorConfig(DetectorConfig(mask_threshold=threshold))
    frames = FrameSets([], [(Path("frames.h5"), 0)])
    trainee = DetectorTraining(HalfSure(), frames, config, torch.device("cpu"))
    assert trainee.validate()["mask_ap"] == pytest.approx(precision, abs=0.15)
