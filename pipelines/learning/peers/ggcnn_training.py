"""GG-CNN as a `Trainee`: crops of depth, maps painted from rectangles."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from pipelines.array_types import Array, Singles
from pipelines.configs.peers import PeerNetworkConfig, PeerSchedule
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import read_rect
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.grasping.peers.grasp_maps import MAP_SIDE, GraspMaps, scaled_rows
from pipelines.grasping.peers.rectangles import RectColumn, hold_at, on_their_object
from pipelines.learning.peers.peer import Arrays, Drawn, Peer, PeerTraining, mean_figures
from pipelines.network.peers.ggcnn import GGCNN, MAPS
from pipelines.network.peers.ggcnn_input import normalised, whole_depth
from pipelines.tabletop.depth_channels import height_plane, shrink

STORED_SIDE = 480  # pixels, longest shorter side of a stored frame
DEPTH_UNITS = 10_000.0  # per metre
LABEL_FRICTION = 0.4  # largest friction coefficient of a labelled rectangle
MIN_ZOOM = 0.5  # least share of the shorter side that a crop shows


@dataclass(frozen=True)
class Crops:
    """Crops (B, 1, 300, 300) of depth, and their maps (B, 4, 300, 300)."""

    depth: Tensor
    maps: Tensor


def ggcnn_frame(
    root: GraspNetRoot, files: FrameFiles, config: PeerNetworkConfig | None = None
) -> Arrays:
    """Return the depth of a frame without holes, and the rectangles on its visible objects.

    `depth` (h, w) uint16 in tenths of a millimetre, the shorter side at most `STORED_SIDE`;
    `rows` (n, 7) float32, pixels of `depth`.
    """
    depth, intrinsics = root.read_depth(files)
    rows = read_rect(files.path("rect")).astype(np.float64)
    rows = rows[hold_at(rows, LABEL_FRICTION)]
    rows = rows[on_their_object(rows, root.read_label(files))]
    small = shrink(None, depth, intrinsics, STORED_SIDE, max(depth.shape))
    if min(depth.shape) > STORED_SIDE:
        rows = scaled_rows(rows, min(small.depth.shape) / min(depth.shape))
    else:
        small = shrink(None, depth, intrinsics, *sorted(depth.shape))
    whole = whole_depth(small.depth, small.intrinsics, height_plane(small))
    stored = np.clip(np.round(whole * DEPTH_UNITS), 1, 65535).astype(np.uint16)
    return {"depth": stored, "rows": rows.astype(np.float32)}


def random_crop(frame: Arrays, rng: np.random.Generator) -> tuple[Singles, GraspMaps]:
    """Return a square part of a frame, 50 to 100 % of its shorter side, turned by right angles."""
    height, width = frame["depth"].shape
    side = int(min(height, width) * rng.uniform(MIN_ZOOM, 1.0))
    x, y = (int(rng.integers(size - side + 1)) for size in (width, height))
    return crop(frame, x, y, side, int(rng.integers(4)))


def middle_crop(frame: Arrays) -> tuple[Singles, GraspMaps]:
    """Return the central square of a frame, the input that the network is made for."""
    height, width = frame["depth"].shape
    side = min(height, width)
    return crop(frame, (width - side) // 2, (height - side) // 2, side, 0)


def crop(frame: Arrays, x: int, y: int, side: int, turns: int) -> tuple[Singles, GraspMaps]:
    """Return the square at (x, y), turned counter-clockwise, at 300 pixels, and its maps."""
    depth = frame["depth"][y : y + side, x : x + side].astype(np.float32) / np.float32(DEPTH_UNITS)
    shrinks = side > MAP_SIDE
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized = cv2.resize(np.rot90(depth, turns), (MAP_SIDE, MAP_SIDE), interpolation=method)
    rows = frame["rows"].astype(np.float64)
    for columns in (RectColumn.CENTER, RectColumn.SIDE):
        rows[:, columns] -= np.array([x, y])
    for _ in range(turns):
        rows = turned_rows(rows, side)
    painted = GraspMaps.painted(scaled_rows(rows, MAP_SIDE / side), (MAP_SIDE, MAP_SIDE))
    return normalised(np.asarray(resized, np.float32)), painted


def turned_rows(rows: Array, side: int) -> Array:
    """Return rectangles `rows` (n, 7) of a square image that is turned counter-clockwise once."""
    moved = rows.copy()
    moved[:, [0, 2]], moved[:, [1, 3]] = rows[:, [1, 3]], side - 1 - rows[:, [0, 2]]
    return moved


def stacked(crops: Sequence[tuple[Singles, GraspMaps]]) -> Crops:
    """Return crops and their maps as tensors."""
    depth = torch.from_numpy(np.stack([each for each, _ in crops]))[:, None]
    maps = np.stack([np.stack([getattr(each, name) for name in MAPS]) for _, each in crops])
    return Crops(depth, torch.from_numpy(maps))


def map_errors(
    module: nn.Module, crops: Crops, device: torch.device, generator: torch.Generator | None = None
) -> dict[str, Tensor]:
    """Return the mean squared error of each map, and their sum as `total`."""
    depth = crops.depth.to(device, memory_format=torch.channels_last)
    wanted = crops.maps.to(device)
    found = module(depth)
    terms = {
        name: nn.functional.mse_loss(found[:, i].float(), wanted[:, i])
        for i, name in enumerate(MAPS)
    }
    return {"total": torch.stack(list(terms.values())).sum()} | terms


class GGCNNTraining(PeerTraining):
    """A `Trainee`: GG-CNN with its training frames and its validation frames."""

    peer = Peer(
        schedule=PeerSchedule(
            steps=5000, epoch_steps=250, batch_size=8, learning_rate=0.001, decay_steps=2000
        ),
        needs=("rect",),
        labels="rows",
        learns_without=True,
        build=GGCNN,
        prepare=ggcnn_frame,
        item=Crops,
        terms=map_errors,
        cpu_micro_batch=4,  # crops
        layout=torch.channels_last,
    )

    def examples(self, drawn: Drawn) -> Crops:
        """Return a random crop of each frame."""
        return stacked([random_crop(frame, rng) for frame, rng in drawn])

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the loss on the middle crops of at most `max_val_frames` validation frames."""
        crops = (stacked([middle_crop(frame)]) for frame in self.validation_frames())
        return mean_figures([map_errors(self.module, each, self.device) for each in crops])
