"""Boxes of a region proposal network, with less work than torchvision's.

Only the best anchors are turned into boxes, not all, and boxes are compared with those of their own
level alone, as they never suppress one of another level.
"""

from collections.abc import Mapping
from functools import reduce

import torch
from torch import Tensor, nn
from torchvision.models.detection.image_list import ImageList
from torchvision.models.detection.rpn import RegionProposalNetwork
from torchvision.ops import clip_boxes_to_image, nms, remove_small_boxes

PARTS = (  # of torchvision's network that are used below; none is documented
    "anchor_generator.cell_anchors",
    "anchor_generator.set_cell_anchors",
    "box_coder.decode_single",
    "head",
    "min_size",
    "nms_thresh",
    "post_nms_top_n",
    "pre_nms_top_n",
)


class Proposals(nn.Module):
    """A trained region proposal network at inference, with the boxes of torchvision's `rpn`."""

    def __init__(self, rpn: RegionProposalNetwork) -> None:
        super().__init__()
        self.rpn = rpn

    @staticmethod
    def fits(rpn: RegionProposalNetwork) -> bool:
        """Return whether `rpn` is built as it is here expected: else it must be used itself."""
        missing = object()
        return all(
            reduce(lambda part, name: getattr(part, name, missing), path.split("."), rpn)
            is not missing
            for path in PARTS
        )

    def forward(
        self, images: ImageList, maps: Mapping[str, Tensor], targets: None = None
    ) -> tuple[list[Tensor], dict[str, Tensor]]:
        """Return the boxes (n, 4) of each image, the likeliest first, and no losses.

        `maps`: (B, C, h, w) each, finest first. Boxes: x0, y0, x1, y1 in pixels.
        """
        del targets
        levels = list(maps.values())
        self.rpn.anchor_generator.set_cell_anchors(levels[0].dtype, levels[0].device)
        scores, deltas = self.rpn.head(levels)
        height, width = images.tensors.shape[-2:]
        best = [
            self._best(*of_level, (height, width))
            for of_level in zip(scores, deltas, self.rpn.anchor_generator.cell_anchors, strict=True)
        ]
        numbers = [each[0].shape[1] for each in best]
        decoded = zip(*(torch.cat(each, 1) for each in zip(*best, strict=True)), strict=True)
        boxes = []
        for (score, anchor, delta), size in zip(decoded, images.image_sizes, strict=True):
            box = clip_boxes_to_image(self.rpn.box_coder.decode_single(delta, anchor), size)
            boxes.append(self._apart(box, torch.sigmoid(score), numbers))
        return boxes, {}

    def _best(
        self, scores: Tensor, deltas: Tensor, cells: Tensor, size: tuple[int, int]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the scores (B, k), anchors (B, k, 4) and deltas (B, k, 4) of a level's best.

        `scores` (B, a, h, w) and `deltas` (B, 4 a, h, w) of the anchors of each place, `cells`
        (a, 4) about it; `size`: height and width in pixels of the images.
        """
        number, (height, width) = len(cells), scores.shape[-2:]
        scores = scores.movedim(1, -1).flatten(1)
        deltas = deltas.movedim(1, -1).reshape(len(deltas), -1, 4)
        best, at = scores.topk(min(self.rpn.pre_nms_top_n(), scores.shape[1]), dim=1)
        place = at.div(number, rounding_mode="floor")
        x = place % width * (size[1] // width)
        y = place.div(width, rounding_mode="floor") * (size[0] // height)
        anchors = torch.stack([x, y, x, y], -1) + cells[at % number]
        return best, anchors, deltas.take_along_dim(at[..., None], 1)

    def _apart(self, boxes: Tensor, scores: Tensor, numbers: list[int]) -> Tensor:
        """Return the likeliest of `boxes` (n, 4), by non-maximum suppression within each level.

        `numbers`: of the boxes of each level, which come one level after the other.
        """
        kept = []
        for level in torch.arange(len(boxes), device=boxes.device).split_with_sizes(numbers):
            large = level[remove_small_boxes(boxes[level], self.rpn.min_size)]
            kept.append(large[nms(boxes[large], scores[large], self.rpn.nms_thresh)])
        left = torch.cat(kept)
        order = scores[left].argsort(descending=True, stable=True)
        return boxes[left[order[: self.rpn.post_nms_top_n()]]]
