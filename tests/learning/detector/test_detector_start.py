"""First weights of a detector: drawn from a seed, or given; weights of others are refused."""

from dataclasses import replace

import pytest
import torch
from torchvision.models.detection import maskrcnn_resnet50_fpn

from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.errors import FormatError, UnknownNameError, ValueRangeError
from pipelines.learning.detector.detector_start import read_coco, starting_detector
from pipelines.network.detection.detector import MODEL_NAME
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import save_weights

CONFIG = FinetuneDetectorConfig()


def test_a_seed_draws_the_same_detector_and_leaves_torchs_generator_alone():
    before = torch.get_rng_state()
    first, again, other = (starting_detector(CONFIG, seed).state_dict() for seed in (3, 3, 4))
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not all(torch.equal(first[name], other[name]) for name in first)
    assert torch.equal(torch.get_rng_state(), before)


def test_given_weights_are_taken_completely(tmp_path):
    path = tmp_path / "detector.safetensors"
    given = starting_detector(CONFIG, 5).state_dict()
    save_weights(path, given, weights_metadata(MODEL_NAME, CONFIG.detector))
    found = starting_detector(CONFIG, 6, init=path).state_dict()
    assert all(torch.equal(found[name], given[name]) for name in given)


def test_given_weights_of_another_detector_are_refused_by_name(tmp_path):
    path = tmp_path / "detector.safetensors"
    given = starting_detector(CONFIG, 5).state_dict()
    save_weights(path, given, weights_metadata(MODEL_NAME, CONFIG.detector))
    other = replace(CONFIG, detector=replace(CONFIG.detector, input="color"))
    with pytest.raises(FormatError, match="--input geometry; --variant light --input color is"):
        starting_detector(other, 6, init=path)


def test_two_streams_start_with_the_features_of_a_depth_detector(tmp_path):
    path = tmp_path / "detector.safetensors"
    geometry = starting_detector(CONFIG, 5).eval()
    save_weights(path, geometry.state_dict(), weights_metadata(MODEL_NAME, CONFIG.detector))
    config = replace(CONFIG, detector=replace(CONFIG.detector, input="both"))
    both = starting_detector(config, 6, init=path).eval()
    image = torch.rand(2, 9, 64, 96, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        expected, found = geometry.backbone(image[:, 3:]), both.backbone(image)
    for name in expected:
        torch.testing.assert_close(found[name], expected[name])


def test_coco_weights_are_for_resnet50_only():
    with pytest.raises(ValueRangeError, match="resnet50"):
        starting_detector(CONFIG, 0, "weights.pth")


OLD_NAMES = {
    "rpn.head.conv.0.0": "rpn.head.conv",
    "roi_heads.mask_head.0.0": "roi_heads.mask_head.mask_fcn1",
    "roi_heads.mask_head.1.0": "roi_heads.mask_head.mask_fcn2",
    "roi_heads.mask_head.2.0": "roi_heads.mask_head.mask_fcn3",
    "roi_heads.mask_head.3.0": "roi_heads.mask_head.mask_fcn4",
} | {
    f"backbone.fpn.{kind}_blocks.{i}.0": f"backbone.fpn.{kind}_blocks.{i}"
    for kind in ("inner", "layer")
    for i in range(4)
}  # fmt: skip


def as_published(state):
    """Return a state_dict with the names of torchvision's published file of 2019."""
    renamed = {}
    for name, tensor in state.items():
        stem, _, last = name.rpartition(".")
        if last != "num_batches_tracked":
            renamed[f"{OLD_NAMES.get(stem, stem)}.{last}"] = tensor
    return renamed


@pytest.mark.parametrize("channels", ["color", "both"])
def test_coco_weights_give_all_but_the_predictors(tmp_path, channels):
    config = replace(CONFIG, detector=DetectorConfig(variant="resnet50", input=channels))
    given = maskrcnn_resnet50_fpn(weights=None, weights_backbone=None).state_dict()
    published = as_published(given)
    assert "rpn.head.conv.weight" in published
    torch.save(published, tmp_path / "coco.pth")
    found = starting_detector(config, 0, str(tmp_path / "coco.pth")).state_dict()
    new = {n for n, tensor in found.items() if not torch.equal(tensor, given[n])}
    predictors = ("box_predictor.cls_score", "box_predictor.bbox_pred", "mask_fcn_logits")
    other = {n for n in new if not any(each in n for each in predictors)}
    assert other == (set() if channels == "color" else {"backbone.body.conv1.weight"})


def test_weights_of_another_network_are_no_coco_weights(tmp_path):
    config = replace(CONFIG, detector=DetectorConfig(variant="resnet50"))
    torch.save({"encoder.weight": torch.zeros(3)}, tmp_path / "other.pth")
    with pytest.raises(FormatError, match=r"other\.pth.*maskrcnn_resnet50_fpn"):
        starting_detector(config, 0, str(tmp_path / "other.pth"))


def test_weights_that_run_code_are_refused(tmp_path):
    path = tmp_path / "coco.pth"
    path.write_bytes(b"\x80\x02cos\nsystem\n.")
    with pytest.raises(FormatError, match="cannot be read as weights"):
        read_coco(str(path))


def test_an_unknown_variant_names_the_known_ones():
    config = replace(CONFIG, detector=DetectorConfig(variant="yolo"))
    with pytest.raises(UnknownNameError, match="light, resnet50"):
        starting_detector(config, 0)
