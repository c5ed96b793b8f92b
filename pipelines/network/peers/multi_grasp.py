"""Multi-Grasp: a detector of grasp rectangles with orientations as classes.

Chu, Xu, Vela: Real-World Multiobject, Multigrasp Detection, RA-L 2018. `full` has the published
layers, ResNet-50 to its fourth stage with 28,459,738 parameters; `light` has the same parts on the
backbone of the light region detector.
"""

from collections import OrderedDict

from torch import Tensor, nn
from torchvision.models import resnet50
from torchvision.models.detection import FasterRCNN
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor
from torchvision.ops import MultiScaleRoIAlign

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.detection.backbone import LightBackbone
from pipelines.network.detection.mask_rcnn import (
    ASPECT_RATIOS,
    BOX_SIDE,
    LIGHT_HIDDEN,
    LIGHT_WIDTH,
    adapt,
    light_anchors,
    light_box_head,
    light_pool,
)

ORIENTATIONS = 20  # outputs: no grasp, and 19 orientations; the last equals the first
RGD = 3  # channels
SHORT_SIDES = {"light": 288, "full": 600}  # pixels of the image that the network sees
LONG_SIDES = {"light": 512, "full": 1000}
MIN_SCORE = 0.01  # least score of a grasp; the original has 0 for its precision, 0.1 in use
MOST_GRASPS_FOUND = 400
SAME_CLASS_OVERLAP = 0.3  # overlap of horizontal boxes beyond which the weaker is dropped


def build_multi_grasp(config: PeerNetworkConfig) -> FasterRCNN:
    """Return an untrained network; it takes lists of RGD images (3, h, w) of `rgd_tensor`."""
    model = {"light": _light, "full": _full}[config.variant]()
    adapt(model)
    return model


def _light() -> FasterRCNN:
    return FasterRCNN(
        LightBackbone(RGD, LIGHT_WIDTH),
        rpn_anchor_generator=light_anchors(),
        rpn_pre_nms_top_n_train=1000,
        rpn_pre_nms_top_n_test=1000,
        rpn_post_nms_top_n_train=400,
        rpn_post_nms_top_n_test=300,
        rpn_batch_size_per_image=128,
        box_roi_pool=light_pool(BOX_SIDE),
        box_head=light_box_head(),
        box_predictor=FastRCNNPredictor(LIGHT_HIDDEN, ORIENTATIONS),
        box_batch_size_per_image=96,
        box_score_thresh=MIN_SCORE,
        box_nms_thresh=SAME_CLASS_OVERLAP,
        box_detections_per_img=MOST_GRASPS_FOUND,
    )


def _full() -> FasterRCNN:
    network = resnet50(weights=None)
    last = network.layer4
    last[0].conv2.stride = last[0].downsample[0].stride = (1, 1)  # regions come at 7 x 7
    return FasterRCNN(
        _FourStages(network),
        rpn_anchor_generator=AnchorGenerator(((128, 256, 512),), (ASPECT_RATIOS,)),
        rpn_head=_ProposalHead(1024, 512, 3 * len(ASPECT_RATIOS)),
        rpn_pre_nms_top_n_train=12000,
        rpn_pre_nms_top_n_test=6000,
        rpn_post_nms_top_n_train=2000,
        rpn_post_nms_top_n_test=300,
        box_roi_pool=MultiScaleRoIAlign(["0"], output_size=BOX_SIDE, sampling_ratio=2),
        box_head=nn.Sequential(last, nn.AdaptiveAvgPool2d(1), nn.Flatten(1)),
        box_predictor=FastRCNNPredictor(2048, ORIENTATIONS),
        box_batch_size_per_image=256,
        box_score_thresh=MIN_SCORE,
        box_nms_thresh=SAME_CLASS_OVERLAP,
        box_detections_per_img=MOST_GRASPS_FOUND,
    )


class _FourStages(nn.Module):
    """ResNet-50 up to its fourth stage: 1024 channels at a sixteenth of the size."""

    out_channels = 1024

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        names = ("conv1", "bn1", "relu", "maxpool", "layer1", "layer2", "layer3")
        self.body = nn.Sequential(*(getattr(network, name) for name in names))

    def forward(self, image: Tensor) -> dict[str, Tensor]:
        return OrderedDict({"0": self.body(image)})


class _ProposalHead(nn.Module):
    """The published head of proposals: two scores per anchor, of which the difference counts."""

    def __init__(self, in_dim: int, hidden: int, anchors: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(in_dim, hidden, 3, padding=1)
        self.scores = nn.Conv2d(hidden, 2 * anchors, 1)
        self.boxes = nn.Conv2d(hidden, 4 * anchors, 1)
        for layer in (self.conv, self.scores, self.boxes):
            nn.init.normal_(layer.weight, std=0.01)
            nn.init.constant_(layer.state_dict()["bias"], 0.0)

    def forward(self, maps: list[Tensor]) -> tuple[list[Tensor], list[Tensor]]:
        logits, deltas = [], []
        for each in maps:
            hidden = self.conv(each).relu()
            none, some = self.scores(hidden).chunk(2, dim=1)
            logits.append(some - none)  # the softmax of two is the sigmoid of their difference
            deltas.append(self.boxes(hidden))
        return logits, deltas
