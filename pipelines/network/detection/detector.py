"""The trained region detector as a function from a frame to masks of symmetric regions."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchvision.models.detection import MaskRCNN
from torchvision.models.detection.roi_heads import RoIHeads

from pipelines.array_types import Array, Mask, Singles
from pipelines.configs import DetectorConfig
from pipelines.errors import ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.network.cpu.folding import folded
from pipelines.network.cpu.roi_align import ChannelsLastRoIAlign
from pipelines.network.detection.mask_rcnn import build_detector
from pipelines.network.devices import find_device
from pipelines.network.imagenet import IMAGENET_MEAN, IMAGENET_STD
from pipelines.network.weights_files import fill, read_weights
from pipelines.tabletop.depth_channels import SmallFrame, depth_channels, height_plane, shrink

MODEL_NAME = "RegionDetector"
MIN_SIDE = 1e-6  # pixels, of a box without extent


@dataclass(frozen=True)
class Detection:
    """One detected region of a frame."""

    mask: Mask  # (H, W), at the frame's size
    box: Array  # (4,) x0, y0, x1, y1 in pixels of the frame
    confidence: float  # in [0, 1]


@dataclass(frozen=True)
class ExaminedFrame:
    """A frame that the detector has seen: its regions, and the confidence in any other box."""

    detections: list[Detection]  # the most confident first
    _heads: RoIHeads
    _features: dict[str, Tensor]
    _size: tuple[int, int]  # height, width of the network's image
    _scale: Array  # (4,) pixels of the frame per pixel of that image

    @torch.inference_mode()
    def confidences(self, boxes: Array) -> Array:
        """Return the confidence (n,), 0 to 1, that each of `boxes` bounds a region.

        `boxes`: (n, 4) x0, y0, x1, y1 in pixels of the frame. It is the confidence that a detection
        with this box would have; most of these boxes were never proposed.
        """
        device = next(iter(self._features.values())).device
        scaled = torch.as_tensor(boxes / self._scale, dtype=torch.float32, device=device)
        pooled = self._heads.box_roi_pool(self._features, [scaled], [self._size])
        classes, _ = self._heads.box_predictor(self._heads.box_head(pooled))
        confidence: Array = torch.softmax(classes, -1)[:, 1].double().cpu().numpy()
        return confidence


class RegionDetector:
    """Mask R-CNN with the preparation of its input and with masks at the size of the frame."""

    def __init__(self, model: MaskRCNN, config: DetectorConfig, device: torch.device) -> None:
        self.config, self.device = config, device
        self.model = folded(model.to(device)).to(memory_format=torch.channels_last)
        heads = self.model.roi_heads
        for pooling in (heads.box_roi_pool, heads.mask_roi_pool):
            pooling.__class__ = ChannelsLastRoIAlign  # the class alone decides how it pools
        # Boxes that `examine` drops need no mask: a weaker box never suppresses a stronger one.
        heads.score_thresh = max(config.candidate_confidence, config.min_confidence)

    @classmethod
    def load(cls, path: Path, device: str = "auto") -> Self:
        """Read weights that `symgrasp finetune-detector` wrote.

        Raises:
            FormatError: the file holds no weights of this detector.
        """
        found = find_device(device)
        tensors, config = read_weights(path, MODEL_NAME, DetectorConfig)
        model = build_detector(config)
        fill(model, tensors, path)
        return cls(model, config, found)

    @torch.inference_mode()
    def examine(
        self,
        color: NDArray[np.uint8],
        depth: Singles,
        intrinsics: Intrinsics,
        plane: Plane | None = None,
    ) -> ExaminedFrame:
        """Return the regions of a frame, most confident first, with the means to rate other boxes.

        Args:
            color: (H, W, 3) RGB.
            depth: (H, W) metres, 0 = missing.
            intrinsics: intrinsics of both images.
            plane: support plane, camera frame; by default found in the depth image.

        Raises:
            ValueRangeError: the images do not have the size of `intrinsics`.
        """
        size = (intrinsics.height, intrinsics.width)
        if color.shape != (*size, 3) or depth.shape != size:
            found = f"{color.shape} and {depth.shape}"
            raise ValueRangeError("shapes of colour and depth", found, f"of an image of {size}")
        frame = self.resized(color, depth, intrinsics)
        known = height_plane(frame) if plane is None else plane
        image = detector_image(frame, known, self.config.input).to(self.device)
        model, shape = self.model, (image.shape[-2], image.shape[-1])
        images, _ = model.transform([image])
        features = model.backbone(images.tensors)
        proposals, _ = model.rpn(images, features)
        found, _ = model.roi_heads(features, proposals, images.image_sizes)
        (found_regions,) = model.transform.postprocess(found, images.image_sizes, [shape])
        scale = np.array([size[1] / shape[1], size[0] / shape[0]] * 2)
        detections = self._detections(found_regions, scale, size)
        return ExaminedFrame(detections, model.roi_heads, features, shape, scale)

    def resized(
        self, color: NDArray[np.uint8], depth: Singles, intrinsics: Intrinsics
    ) -> SmallFrame:
        """Return the frame at the size of the network's input: larger than in training (D. 84).

        `color`: (H, W, 3) RGB. `depth`: (H, W) metres, 0 where missing.
        """
        trained = self.config.min_size, self.config.max_size
        sides = (round(self.config.enlarged * side) for side in trained)
        seen = None if self.config.input == "geometry" else color
        return shrink(seen, depth, intrinsics, *sides)

    def _detections(
        self, found: dict[str, Tensor], scale: Array, size: tuple[int, int]
    ) -> list[Detection]:
        detections = []
        for box, confidence, soft in zip(
            found["boxes"].cpu().numpy(),
            found["scores"].cpu().numpy(),
            found["masks"][:, 0].cpu().numpy(),
            strict=True,
        ):
            if confidence < self.config.min_confidence:
                continue
            full = box.astype(np.float64) * scale
            mask = draw_mask(soft, full, size, self.config.mask_threshold)
            if mask.any():
                detections.append(Detection(mask, full, float(confidence)))
        return detections


def draw_mask(soft: Singles, box: Array, size: tuple[int, int], threshold: float = 0.5) -> Mask:
    """Return the mask (H, W) = `size` of probabilities (28, 28) stretched over `box`, in pixels.

    The outermost probabilities fade to zero within half a cell beyond the box.
    """
    mask = np.zeros(size, bool)
    x0, y0 = np.maximum(np.floor(box[:2]).astype(int), 0)
    x1, y1 = np.minimum(np.ceil(box[2:]).astype(int), (size[1], size[0]))
    if x1 <= x0 or y1 <= y0:
        return mask
    cells = soft.shape[0]
    u = (np.arange(x0, x1) + 0.5 - box[0]) / max(box[2] - box[0], MIN_SIDE) * cells - 0.5
    v = (np.arange(y0, y1) + 0.5 - box[1]) / max(box[3] - box[1], MIN_SIDE) * cells - 0.5
    map_u, map_v = np.meshgrid(u.astype(np.float32), v.astype(np.float32))
    values = cv2.remap(
        soft.astype(np.float32), map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
    )
    mask[y0:y1, x0:x1] = values >= threshold
    return mask


def detector_image(frame: SmallFrame, plane: Plane, kind: str) -> Tensor:
    """Return the input (C, h, w) float32: colour, geometry, or colour and then geometry (D. 19).

    `kind`: geometry, color or both. `plane`: the support plane, camera frame.
    """
    parts: list[Singles] = []
    if kind in {"color", "both"}:
        normalised = (frame.color / 255.0 - np.array(IMAGENET_MEAN)) / np.array(IMAGENET_STD)
        parts.append(np.ascontiguousarray(np.moveaxis(normalised, -1, 0), np.float32))
    if kind in {"geometry", "both"}:
        parts.append(depth_channels(frame.depth, frame.intrinsics, plane))
    return torch.from_numpy(parts[0] if len(parts) == 1 else np.concatenate(parts))
