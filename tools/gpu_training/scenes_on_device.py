"""Clouds of GraspNet's baseline with their labels, assembled on the GPU.

Each cloud has 15 million cells to fill and reorder, which takes most of a second on a core; here
frames are on the device and a cloud takes milliseconds.
"""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pipelines.dataset.graspnet.graspnet_views import generate_views, view_rotations
from pipelines.geometry.transforms import rotation_about
from pipelines.learning.peers.graspnet_clouds import MOST_LABELLED, LabelledScene
from pipelines.learning.peers.graspnet_labels import (
    CELLS,
    LEVELS,
    STORED_PER_METRE,
    UNITS,
    VIEW_CELLS,
)
from pipelines.learning.peers.graspnet_training import MOST_TURN, GraspNetTraining, mean_terms
from pipelines.learning.peers.peer import Arrays, Drawn, mean_figures, read_peer_frame
from pipelines.network.peers.graspnet import GRASPNET_SIZES, WIDEST_OPENING, WIDEST_TOLERANCE

FRAMES_ON_DEVICE = 4096  # frames on the device


def scene_on_device(
    frame: Mapping[str, Tensor], count: int, generator: torch.Generator, turn: float
) -> LabelledScene:
    """Return the result of `labelled_scene` for a frame with tensors on one device."""
    device = frame["cloud"].device
    R = torch.from_numpy(rotation_about(frame["up"].cpu().numpy().astype(np.float64), turn))
    R = R.float().to(device)
    cloud = frame["cloud"] / UNITS
    middle = cloud.mean(dim=0)
    chosen = torch.randperm(len(cloud), generator=generator, device=device)[:count]
    if len(cloud) < count:
        more = torch.randint(len(cloud), (count - len(cloud),), generator=generator, device=device)
        chosen = torch.cat([chosen, more])
    order = torch.randperm(len(frame["points"]), generator=generator, device=device)
    labelled = order[:MOST_LABELLED].sort().values
    owner = frame["object"][labelled].long()
    turns = R @ frame["turns"]
    views, rotations = (torch.from_numpy(each).to(device) for each in _views())
    nearest = torch.einsum("vi,kij,wj->kvw", views, turns, views).argmax(dim=2)
    along = torch.einsum("kij,kvjl->kvil", turns, rotations[nearest])
    rows = nearest[owner][..., None].expand(-1, -1, VIEW_CELLS[1])
    return LabelledScene(
        (cloud[chosen] - middle) @ R.T + middle,
        frame["on_object"][chosen],
        (frame["points"][labelled] - middle) @ R.T + middle,
        along[owner],
        *(each.gather(1, rows) for each in _dense_cells(frame, labelled)),
    )


def _views() -> tuple[np.ndarray, np.ndarray]:
    return generate_views().astype(np.float32), view_rotations()[:, 0]


def _dense_cells(frame: Mapping[str, Tensor], labelled: Tensor) -> tuple[Tensor, ...]:
    """Return value, width and tolerance (p, 300, 48) of the points `labelled` (p,)."""
    place = torch.full((len(frame["points"]),), -1, device=labelled.device)
    place[labelled] = torch.arange(len(labelled), device=labelled.device)
    row = place[frame["point"].long()]
    kept = row >= 0
    where = row[kept] * CELLS + frame["cell"][kept]
    columns = (
        -(frame["friction"][kept] / LEVELS).clamp(max=1.0).log(),
        frame["width"][kept] / (WIDEST_OPENING * STORED_PER_METRE),
        frame["tolerance"][kept] / (WIDEST_TOLERANCE * STORED_PER_METRE),
    )
    dense = []
    for column in columns:
        flat = torch.zeros(len(labelled) * CELLS, device=labelled.device)
        flat[where] = column
        dense.append(flat.view(len(labelled), *VIEW_CELLS))
    return tuple(dense)


class GraspNetOnDevice(GraspNetTraining):
    """`GraspNetTraining` with its frames on its device."""

    def examples(self, drawn: Drawn) -> list[LabelledScene]:
        """Return each frame, turned at random about the table's normal."""
        return [self._scene(frame, rng, rng.uniform(-MOST_TURN, MOST_TURN)) for frame, rng in drawn]

    def source(self, number: int) -> dict[str, Tensor]:
        """Return the training frame `number`."""
        return self._on_device(*self.frames.train[number])

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the loss terms on the validation frames, unturned."""
        scenes = (
            self._scene(_tensors(frame, self.device), np.random.default_rng(0), 0.0)
            for frame in self.validation_frames()
        )
        return mean_figures([mean_terms(self.module, [each], self.device) for each in scenes])

    def _scene(
        self, frame: Mapping[str, Tensor], rng: np.random.Generator, turn: float
    ) -> LabelledScene:
        generator = torch.Generator(self.device).manual_seed(int(rng.integers(2**62)))
        count = GRASPNET_SIZES[self.config.network.variant].input
        return scene_on_device(frame, count, generator, turn)

    @lru_cache(maxsize=FRAMES_ON_DEVICE)  # noqa: B019 - one training per process
    def _on_device(self, path: Path, row: int) -> dict[str, Tensor]:
        return _tensors(read_peer_frame.__wrapped__(path, row), self.device)


def _tensors(frame: Arrays, device: torch.device) -> dict[str, Tensor]:
    return {name: torch.from_numpy(each).to(device) for name, each in frame.items()}
