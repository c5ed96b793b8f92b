"""Packed folders of toy regions, and settings small enough for a test."""

from pathlib import Path

import numpy as np

from pipelines.configs import NetworkConfig, TrainConfig
from pipelines.dataset.training import packed_regions
from pipelines.dataset.training.packed_regions import PackedScene
from pipelines.storage.provenance import make_stamp
from tests.network.toy_regions import toy_batch

PLACE = np.array([0.1, 0.0, 0.7], np.float32)  # metres, camera frame
NETWORK = NetworkConfig(
    num_points=96, set_points=(32, 16, 8, 4), set_neighbors=(8, 8, 8, 8), set_strides=(1, 1, 1, 1)
)
CONFIG = TrainConfig(
    network=NETWORK, batch_size=6, micro_batch_size=3, num_loss_points=32, epochs=2, ema_decay=0.9
)


def write_packed(folder: Path, scenes: int = 3, regions: int = 12) -> Path:
    """Write `scenes` files of `regions` boxes, cans and balls each."""
    for number in range(scenes):
        batch = toy_batch(max(regions, 1), 120, seed=number)[:regions]
        empty = batch.existence.numpy()[..., None] == 0
        headed = empty | (np.arange(5) == 4)[:, None]
        scene = PackedScene(
            points=batch.points.numpy() + PLACE,
            affordance=batch.affordance.numpy(),
            existence=batch.existence.numpy(),
            point=np.where(empty, np.nan, batch.center.numpy() + PLACE),
            direction=np.where(headed, np.nan, batch.direction.numpy()),
            table=np.full((regions, 4), np.nan),
            object_id=np.arange(regions),
            frame_id=np.zeros(regions, int),
            name=np.array(["object"] * regions, object),
        )
        path = folder / f"scene_{number:04d}_kinect.h5"
        packed_regions.write(path, scene, make_stamp("pack", {}))
    return folder
