"""Mask R-CNN with an FPN (Sec. III-D) in two sizes, for prepared input images."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchvision.models.detection import FasterRCNN, MaskRCNN, maskrcnn_resnet50_fpn
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor
from torchvision.models.detection.image_list import ImageList
from torchvision.models.detection.mask_rcnn import MaskRCNNHeads
from torchvision.models.detection.transform import GeneralizedRCNNTransform
from torchvision.ops import MultiScaleRoIAlign

from pipelines.configs import DetectorConfig
from pipelines.errors import FormatError, UnknownNameError
from pipelines.network.detection.backbone import LightBackbone, TwoStreamBackbone
from pipelines.network.weights_files import tensor_differences

NUM_CLASSES = 2  # background, symmetric region
COCO_CLASSES, MOST_CLASSES = 91, 10_000  # classes of detectors to start from
COLOR_CHANNELS, GEOMETRY_CHANNELS = 3, 6
NUM_CHANNELS = {
    "geometry": GEOMETRY_CHANNELS,
    "color": COLOR_CHANNELS,
    "both": COLOR_CHANNELS + GEOMETRY_CHANNELS,
}
LIGHT_WIDTH = 64  # channels of the light variant's pyramid and mask head
LIGHT_HIDDEN = 256  # channels of the light variant's box head
ANCHOR_SIZES = ((16,), (32,), (64,), (128,), (192,))  # pixels at the network's input
ASPECT_RATIOS = (0.5, 1.0, 2.0)
POOLED_MAPS = ["0", "1", "2", "3"]  # of the light variant's pyramid, at strides 4 to 32
BOX_SIDE, MASK_SIDE = 7, 14  # cells of a box that is pooled for its class, and for its mask


class PreparedImages(GeneralizedRCNNTransform):  # type: ignore[misc] # untyped library
    """torchvision's transform reduced to padding: images are already resized and normalised.

    Masks stay 28 x 28 in the box, as the output of the head: they are drawn later at the size of
    the frame, which the network does not know.
    """

    def __init__(self) -> None:
        super().__init__(1, 1, [0.0], [1.0])

    def forward(
        self, images: list[Tensor], targets: list[dict[str, Tensor]] | None = None
    ) -> tuple[ImageList, list[dict[str, Tensor]] | None]:
        """Return the images padded to one size, and the targets unchanged."""
        sizes = [(int(image.shape[-2]), int(image.shape[-1])) for image in images]
        return ImageList(self.batch_images(images), sizes), targets

    def batch_images(self, images: list[Tensor], size_divisible: int = 32) -> Tensor:
        """Return the images (B, C, H, W), zeros below and to the right, channels last in memory."""
        sides = [max(image.shape[axis] for image in images) for axis in (-2, -1)]
        height, width = (-(-side // size_divisible) * size_divisible for side in sides)
        batch = images[0].new_empty(len(images), height, width, images[0].shape[0]).movedim(-1, 1)
        for padded, image in zip(batch, images, strict=True):
            below, right = image.shape[-2:]
            padded[:, :below, :right] = image
            padded[:, below:], padded[:, :below, right:] = 0.0, 0.0
        return batch

    def postprocess(
        self,
        result: list[dict[str, Tensor]],
        image_shapes: Sequence[tuple[int, int]],
        original_image_sizes: Sequence[tuple[int, int]],
    ) -> list[dict[str, Tensor]]:
        """Return the detections unchanged."""
        return result


class SeededSampler:
    """Draws the anchors or boxes that a loss is computed on, positives up to a share.

    It works as torchvision's sampler, but draws from a given generator, not the global one.
    """

    def __init__(self, batch_size_per_image: int, positive_fraction: float) -> None:
        self.size, self.positive_fraction = batch_size_per_image, positive_fraction
        self.generator = torch.Generator()

    def __call__(self, matched: Sequence[Tensor]) -> tuple[list[Tensor], list[Tensor]]:
        """Return masks of the drawn positives and negatives, one of each per image.

        `matched`: (n,) per image; at least 1 is positive, 0 negative, below neither.
        """
        positives, negatives = [], []
        for labels in matched:
            positive = self._draw(labels >= 1, int(self.size * self.positive_fraction))
            negatives.append(self._draw(labels == 0, self.size - int(positive.sum())))
            positives.append(positive)
        return positives, negatives

    def _draw(self, candidates: Tensor, count: int) -> Tensor:
        indices = candidates.nonzero()[:, 0]
        order = torch.randperm(len(indices), generator=self.generator)[:count]
        chosen = torch.zeros_like(candidates, dtype=torch.bool)
        chosen[indices[order.to(indices.device)]] = True
        return chosen


def build_detector(config: DetectorConfig) -> MaskRCNN:
    """Return an untrained detector.

    Raises:
        UnknownNameError: the variant or the input is unknown.
    """
    if config.input not in NUM_CHANNELS:
        raise UnknownNameError("detector input", config.input, NUM_CHANNELS)
    builders = {"light": _light, "resnet50": _resnet50}
    if config.variant not in builders:
        raise UnknownNameError("detector variant", config.variant, builders)
    model: MaskRCNN = builders[config.variant](NUM_CHANNELS[config.input], config)
    adapt(model)
    return model


def adapt(model: FasterRCNN) -> None:
    """Make a network of torchvision take prepared images and draw by `SeededSampler`."""
    model.transform = PreparedImages()
    for part in (model.rpn, model.roi_heads):
        given = part.fg_bg_sampler
        part.fg_bg_sampler = SeededSampler(given.batch_size_per_image, given.positive_fraction)


def seed_samplers(model: MaskRCNN, generator: torch.Generator) -> None:
    """Make the detector draw from `generator` in training."""
    for part in (model.rpn, model.roi_heads):
        part.fg_bg_sampler.generator = generator


def _limits(config: DetectorConfig) -> dict[str, Any]:
    return {
        "box_detections_per_img": config.max_detections,
        "box_score_thresh": config.candidate_confidence,
        "box_nms_thresh": config.nms_threshold,
    }


def _light(in_channels: int, config: DetectorConfig) -> MaskRCNN:
    backbone = (
        TwoStreamBackbone(COLOR_CHANNELS, GEOMETRY_CHANNELS, LIGHT_WIDTH)
        if config.input == "both"
        else LightBackbone(in_channels, LIGHT_WIDTH)
    )
    return MaskRCNN(
        backbone,
        rpn_anchor_generator=light_anchors(),
        rpn_pre_nms_top_n_train=500,
        rpn_pre_nms_top_n_test=200,
        rpn_post_nms_top_n_train=200,
        rpn_post_nms_top_n_test=60,
        rpn_batch_size_per_image=128,
        box_roi_pool=light_pool(BOX_SIDE),
        box_head=light_box_head(),
        box_predictor=FastRCNNPredictor(LIGHT_HIDDEN, NUM_CLASSES),
        box_batch_size_per_image=96,
        mask_roi_pool=light_pool(MASK_SIDE),
        mask_head=MaskRCNNHeads(LIGHT_WIDTH, (LIGHT_WIDTH,) * 3, 1),
        mask_predictor=nn.Sequential(
            nn.ConvTranspose2d(LIGHT_WIDTH, LIGHT_WIDTH, 2, 2),
            nn.ReLU(),
            nn.Conv2d(LIGHT_WIDTH, NUM_CLASSES, 1),
        ),
        **_limits(config),
    )


def light_anchors() -> AnchorGenerator:
    """Return the anchors on the pyramid of a `LightBackbone`, one size for each map."""
    return AnchorGenerator(ANCHOR_SIZES, (ASPECT_RATIOS,) * len(ANCHOR_SIZES))


def light_pool(side: int) -> MultiScaleRoIAlign:
    """Return the layer that pools boxes of that pyramid to `side` x `side` cells."""
    return MultiScaleRoIAlign(POOLED_MAPS, output_size=side, sampling_ratio=2)


def light_box_head() -> nn.Sequential:
    """Return the layers from pooled boxes to `LIGHT_HIDDEN` numbers each."""
    first = nn.Linear(LIGHT_WIDTH * BOX_SIDE**2, LIGHT_HIDDEN)
    second = nn.Linear(LIGHT_HIDDEN, LIGHT_HIDDEN)
    return nn.Sequential(nn.Flatten(1), first, nn.ReLU(), second, nn.ReLU())


def _resnet50(in_channels: int, config: DetectorConfig) -> MaskRCNN:
    model = maskrcnn_resnet50_fpn(
        weights=None,
        weights_backbone=None,
        num_classes=NUM_CLASSES,
        rpn_post_nms_top_n_test=200,
        **_limits(config),
    )
    if in_channels != COLOR_CHANNELS:
        model.backbone.body.conv1 = nn.Conv2d(in_channels, 64, 7, 2, padding=3, bias=False)
    return model


def adopt_coco(model: MaskRCNN, weights: Mapping[str, Tensor], source: str) -> list[str]:
    """Give the resnet50 variant COCO's `weights` of fitting shapes; return the other names.

    The class predictors of COCO's 91 classes never fit. Input channels beyond colour have no
    counterpart either. `source`: name of the weights, for the message.

    Raises:
        FormatError: the weights are not of torchvision's Mask R-CNN, with any number of classes.
    """
    scores = weights.get("roi_heads.box_predictor.cls_score.bias")
    count = COCO_CLASSES if scores is None or scores.ndim != 1 else min(len(scores), MOST_CLASSES)
    with torch.device("meta"):
        source_model = maskrcnn_resnet50_fpn(weights=None, weights_backbone=None, num_classes=count)
    try:
        # Published files have names of older versions, which torchvision itself translates.
        source_model.load_state_dict(dict(weights), assign=True)
    except RuntimeError as error:
        expected = "the state_dict of torchvision's maskrcnn_resnet50_fpn"
        found = tensor_differences(weights, source_model.state_dict())
        raise FormatError(source, f"holds other tensors ({found})", expected) from error
    own = model.state_dict()
    given = source_model.state_dict().items()
    fitting = {n: t for n, t in given if n in own and own[n].shape == t.shape}
    model.load_state_dict({**own, **fitting})
    return sorted(set(own) - set(fitting))
