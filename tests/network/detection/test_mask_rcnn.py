"""The detector on tiny images: its training, and the places of its masks."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_array_equal

from pipelines.configs import DetectorConfig
from pipelines.errors import UnknownNameError, ValueRangeError
from pipelines.frames.frames import find_frames
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.health.golden import FRAMES
from pipelines.inference.models import DETECTOR_WEIGHTS
from pipelines.network.detection.detector import RegionDetector, draw_mask
from pipelines.network.detection.mask_rcnn import (
    PreparedImages,
    SeededSampler,
    build_detector,
    seed_samplers,
)

CONFIG = DetectorConfig(min_size=96, max_size=128, min_confidence=0.0)


def example():
    image = torch.zeros(6, 96, 128)
    image[3, 20:60, 30:80] = 1.0
    mask = (image[3:4] > 0).to(torch.uint8)
    box = torch.tensor([[30.0, 20.0, 80.0, 60.0]])
    return image, {"boxes": box, "labels": torch.ones(1, dtype=torch.int64), "masks": mask}


def test_a_few_steps_on_one_image_lower_the_loss():
    torch.manual_seed(0)
    model = build_detector(CONFIG).train()
    optimizer = torch.optim.Adam(model.parameters(), 0.002)
    image, target = example()
    totals = []
    for _ in range(8):
        seed_samplers(model, torch.Generator().manual_seed(0))
        total = torch.stack(list(model([image], [target]).values())).sum()
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
        totals.append(float(total.detach()))
    assert totals[-1] < 0.8 * totals[0]


def test_random_samples_depend_only_on_the_generator():
    labels = [torch.cat([torch.ones(30), torch.zeros(70)])]
    drawn = []
    for _ in range(2):
        sampler = SeededSampler(16, 0.25)
        sampler.generator.manual_seed(4)
        drawn.append(sampler(labels))
    assert torch.equal(drawn[0][0][0], drawn[1][0][0])
    assert int(drawn[0][0][0].sum()) == 4
    assert int(drawn[0][1][0].sum()) == 12
    assert not (drawn[0][1][0] & (labels[0] > 0)).any()


def test_an_unknown_input_names_the_known_ones():
    with pytest.raises(UnknownNameError, match="both, color, geometry"):
        build_detector(DetectorConfig(input="thermal"))


def test_images_are_padded_with_zeros_to_one_size_in_channels_last_layout():
    torch.manual_seed(0)
    images = [torch.rand(6, 40, 50), torch.rand(40, 70, 6).movedim(-1, 0)]
    batch, sizes = PreparedImages()(images)[0].tensors, PreparedImages()(images)[0].image_sizes
    assert batch.shape == (2, 6, 64, 96)
    assert batch.is_contiguous(memory_format=torch.channels_last)
    assert sizes == [(40, 50), (40, 70)]
    for padded, image in zip(batch, images, strict=True):
        assert torch.equal(padded[:, : image.shape[1], : image.shape[2]], image)
        assert padded.sum() == pytest.approx(float(image.sum()), rel=1e-4)


def test_the_detector_at_inference_gives_the_output_of_the_trained_model():
    torch.manual_seed(0)
    config = replace(CONFIG, candidate_confidence=0.0)
    model = build_detector(config).eval()
    images = [torch.rand(6, 96, 128), torch.rand(6, 90, 100)]
    with torch.inference_mode():
        found = RegionDetector(model, config, torch.device("cpu")).model(images)
        expected = model(images)
    for ours, theirs in zip(found, expected, strict=True):
        assert len(ours["boxes"]) > 0
        for name in ("boxes", "scores", "masks"):
            torch.testing.assert_close(ours[name], theirs[name], rtol=1e-4, atol=1e-4)


def test_a_full_mask_fills_its_box():
    mask = draw_mask(np.ones((28, 28), np.float32), np.array([10.0, 20.0, 40.0, 50.0]), (60, 80))
    expected = np.zeros((60, 80), bool)
    expected[20:50, 10:40] = True
    assert_array_equal(mask[21:49, 11:39], expected[21:49, 11:39])
    assert not (mask & ~expected).any()


def test_half_a_mask_fills_half_its_box_even_beyond_the_image():
    soft = np.zeros((28, 28), np.float32)
    soft[:, :14] = 1.0
    mask = draw_mask(soft, np.array([-20.0, 0.0, 36.0, 56.0]), (40, 40))
    columns = mask[5:35].mean(0)
    assert (columns[:7] == 1.0).all()
    assert not columns[9:].any()


def test_images_whose_size_differs_from_the_camera_are_refused():
    torch.manual_seed(0)
    detector = RegionDetector(build_detector(CONFIG), CONFIG, torch.device("cpu"))
    camera = Intrinsics(100.0, 100.0, 64.0, 48.0, 128, 96)
    with pytest.raises(ValueRangeError, match="shapes of colour and depth"):
        detector.examine(np.zeros((96, 128, 3), np.uint8), np.zeros((90, 128), np.float32), camera)


def test_a_detected_box_has_the_confidence_of_its_detection():
    # The box of a detection is a refined proposal: rated again, it has about the same confidence.
    frame = find_frames(FRAMES)[0].read()
    detector = RegionDetector.load(DETECTOR_WEIGHTS, "cpu")
    examined = detector.examine(frame.color, frame.depth, frame.intrinsics)
    sure = [each for each in examined.detections if each.confidence > 0.99]
    assert len(sure) >= 4
    assert (examined.confidences(np.array([each.box for each in sure])) > 0.9).all()
    x0, y0, x1, y1 = sure[0].box
    side = np.array([x0, y0, x0 + (x1 - x0) / 5, y1])  # a strip of the object
    table = np.array([2.0, 440.0, 60.0, 478.0])
    assert (examined.confidences(np.array([side, table])) < 0.5).all()
    assert examined.confidences(np.zeros((0, 4))).shape == (0,)


def test_frames_are_larger_at_inference_than_in_training():
    torch.manual_seed(0)
    detector = RegionDetector(build_detector(CONFIG), CONFIG, torch.device("cpu"))
    seen = []
    detector.model.transform.register_forward_pre_hook(
        lambda _, images: seen.append(images[0][0].shape)
    )
    camera = Intrinsics(600.0, 600.0, 320.0, 240.0, 640, 480)
    color, depth = np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.float32)
    found = detector.examine(color, depth, camera).detections
    assert seen == [(6, 128, 170)]  # 96 x 128 times 1.33
    assert all(each.mask.shape == (480, 640) for each in found)


def test_a_frame_without_depth_gives_detections():
    torch.manual_seed(0)
    detector = RegionDetector(build_detector(CONFIG), CONFIG, torch.device("cpu"))
    camera = Intrinsics(100.0, 100.0, 64.0, 48.0, 128, 96)
    for found in detector.examine(
        np.zeros((96, 128, 3), np.uint8), np.zeros((96, 128), np.float32), camera
    ).detections:
        assert found.mask.shape == (96, 128)


def test_only_detections_above_the_confidence_limit_are_kept():
    torch.manual_seed(0)
    model = build_detector(CONFIG).eval()
    depth = np.random.default_rng(0).uniform(0.5, 0.9, (72, 96)).astype(np.float32)
    camera = Intrinsics(90.0, 90.0, 48.0, 36.0, 96, 72)
    frame = np.zeros((72, 96, 3), np.uint8), depth, camera
    every = RegionDetector(model, CONFIG, torch.device("cpu")).examine(*frame).detections
    limit = float(np.median([found.confidence for found in every]))
    config = replace(CONFIG, min_confidence=limit)
    few = RegionDetector(model, config, torch.device("cpu")).examine(*frame).detections
    assert 0 < len(few) < len(every)
    for one, other in zip(few, every, strict=False):
        assert one.confidence == pytest.approx(other.confidence)
        assert_array_equal(one.mask, other.mask)
    assert model.roi_heads.score_thresh == CONFIG.candidate_confidence  # of the trained model


def test_a_given_plane_is_used_instead_of_a_search(monkeypatch):
    torch.manual_seed(0)
    detector = RegionDetector(build_detector(CONFIG), CONFIG, torch.device("cpu"))
    depth = np.random.default_rng(0).uniform(0.5, 0.9, (72, 96)).astype(np.float32)
    frame = np.zeros((72, 96, 3), np.uint8), depth, Intrinsics(90.0, 90.0, 48.0, 36.0, 96, 72)
    plane, other = (Plane(np.array([0.0, 0.0, -1.0]), far) for far in (0.9, 0.6))
    monkeypatch.setattr("pipelines.network.detection.detector.height_plane", lambda _frame: plane)
    searched = [each.confidence for each in detector.examine(*frame).detections]
    assert [each.confidence for each in detector.examine(*frame, plane).detections] == searched
    assert [each.confidence for each in detector.examine(*frame, other).detections] != searched
