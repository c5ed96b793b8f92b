"""Multi-Grasp as a `Trainee`: turned RGD images, boxes with orientations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchvision.models.detection import FasterRCNN

from pipelines.array_types import Array
from pipelines.configs.peers import PeerNetworkConfig, PeerSchedule
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import read_rect
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.grasping.peers.grasp_maps import scaled_rows
from pipelines.grasping.peers.oriented_boxes import (
    horizontal_boxes,
    orientation_classes,
    rows_of_boxes,
    spread_rows,
)
from pipelines.grasping.peers.rectangles import (
    RectColumn,
    hold_at,
    on_their_object,
    rectangle_hits,
)
from pipelines.learning.peers.peer import Arrays, Drawn, Peer, PeerTraining
from pipelines.network.detection.mask_rcnn import seed_samplers
from pipelines.network.peers.multi_grasp import LONG_SIDES, SHORT_SIDES, build_multi_grasp
from pipelines.network.peers.rgd import rgd_pixels, rgd_tensor
from pipelines.tabletop.depth_channels import shrink

LABEL_FRICTION = 0.2  # largest friction coefficient of a labelled rectangle
MOST_ROWS = 60  # rectangles of an object in a frame
SHIFT = 0.1  # share of the shorter side, longest shift of an image
FIRST = 10  # best grasps of a frame that are counted as hits or misses


@dataclass(frozen=True)
class GraspImage:
    """An RGD image as input of the network, and its grasps: `boxes` (n, 4), `labels` (n,)."""

    image: Tensor
    boxes: Tensor
    labels: Tensor


def found_rows(found: Mapping[str, Tensor]) -> Array:
    """Return the network's detections in one image as rectangles (n, 7), best first."""
    boxes, labels, score = (found[name].cpu().numpy() for name in ("boxes", "labels", "scores"))
    order = np.argsort(-score, kind="stable")
    return rows_of_boxes(
        boxes[order].astype(np.float64), labels[order], score[order].astype(np.float64)
    )


def multi_grasp_frame(root: GraspNetRoot, files: FrameFiles, network: PeerNetworkConfig) -> Arrays:
    """Return a frame at the network's size: `pixels` (h, w, 3) RGD, `rows` (n, 7) float32."""
    frame = root.read_frame(files)
    rows = read_rect(files.path("rect")).astype(np.float64)
    rows = rows[hold_at(rows, LABEL_FRICTION)]
    rows = rows[on_their_object(rows, root.read_label(files))]
    rows = rows[spread_rows(rows, MOST_ROWS)]
    variant = network.variant
    sides = SHORT_SIDES[variant], LONG_SIDES[variant]
    small = shrink(frame.color, frame.depth, frame.intrinsics, *sides)
    scaled = scaled_rows(rows, small.intrinsics.width / frame.intrinsics.width)
    return {"pixels": rgd_pixels(small.color, small.depth), "rows": scaled.astype(np.float32)}


def moved_at_random(frame: Arrays, rng: np.random.Generator) -> tuple[NDArray[np.uint8], Array]:
    """Return the pixels and rectangles of a frame, turned by any angle and moved a little."""
    height, width = frame["pixels"].shape[:2]
    reach = SHIFT * min(height, width)
    return moved_image(frame, float(rng.uniform(0.0, 360.0)), rng.uniform(-reach, reach, 2))


def moved_image(frame: Arrays, degrees: float, shift: Array) -> tuple[NDArray[np.uint8], Array]:
    """Return the pixels and rectangles of a frame, turned counter-clockwise, moved by `shift` (2,).

    Depth is from the nearest pixel: a mean across an edge would be between the surfaces.
    """
    pixels, rows = frame["pixels"], frame["rows"].astype(np.float64)
    height, width = pixels.shape[:2]
    T = cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), degrees, 1.0)
    T[:, 2] = T[:, 2] + shift
    turned = cv2.warpAffine(pixels, T, (width, height), flags=cv2.INTER_LINEAR)
    turned[..., 2] = cv2.warpAffine(pixels[..., 2], T, (width, height), flags=cv2.INTER_NEAREST)
    moved = rows.copy()
    for columns in (RectColumn.CENTER, RectColumn.SIDE):
        moved[:, columns] = rows[:, columns] @ T[:, :2].T + T[:, 2]
    return np.asarray(turned, np.uint8), moved


def grasp_image(pixels: NDArray[np.uint8], rows: Array) -> GraspImage:
    """Return an image with its labels: rectangles that have their box inside the image."""
    boxes, classes = horizontal_boxes(rows), orientation_classes(rows)
    size = np.array([pixels.shape[1], pixels.shape[0]])
    inside = (boxes[:, :2] >= 0).all(axis=1) & (boxes[:, 2:] <= size).all(axis=1)
    return GraspImage(
        rgd_tensor(pixels),
        torch.from_numpy(boxes[inside].astype(np.float32)).reshape(-1, 4),
        torch.from_numpy(classes[inside]),
    )


def grasp_losses(
    network: FasterRCNN,
    images: Sequence[GraspImage],
    device: torch.device,
    generator: torch.Generator,
) -> dict[str, Tensor]:
    """Return the losses by name, and their sum as `total`."""
    seed_samplers(network, generator)
    inputs = [each.image.to(device) for each in images]
    targets = [
        {"boxes": each.boxes.to(device), "labels": each.labels.to(device)} for each in images
    ]
    terms: dict[str, Tensor] = network(inputs, targets)
    return {"total": torch.stack(list(terms.values())).sum()} | {
        name.removeprefix("loss_"): term for name, term in terms.items()
    }


class MultiGraspTraining(PeerTraining):
    """A `Trainee`: Multi-Grasp with its training frames and its validation frames."""

    best_by = "hits"
    higher_is_better = True

    peer = Peer(
        schedule=PeerSchedule(
            steps=4000, epoch_steps=250, batch_size=4, learning_rate=0.001, decay_steps=1000
        ),
        needs=("rect",),
        labels="rows",
        learns_without=True,
        build=build_multi_grasp,
        prepare=multi_grasp_frame,
        item=GraspImage,
        terms=grasp_losses,
        cpu_micro_batch=2,  # frames
        layout=torch.channels_last,
    )

    def examples(self, drawn: Drawn) -> list[GraspImage]:
        """Return each frame, turned and moved at random."""
        return [grasp_image(*moved_at_random(frame, rng)) for frame, rng in drawn]

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the share of hits among each frame's best grasps, and among first grasps."""
        hits, first = [], []
        for frame in self.validation_frames():
            (found,) = self.module([rgd_tensor(frame["pixels"]).to(self.device)])
            rows = found_rows(found)[:FIRST]
            right = rectangle_hits(rows, frame["rows"].astype(np.float64))
            hits.append(right.sum() / FIRST)
            first.append(bool(right[:1].any()))
        return {"hits": float(np.mean(hits)), "first": float(np.mean(first))}
