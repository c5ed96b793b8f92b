"""Clouds of GraspNet's baseline with labelled points, as input of a training step."""

from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Singles
from pipelines.dataset.graspnet.graspnet_views import generate_views, view_rotations
from pipelines.geometry.pointcloud import drawn_indices
from pipelines.geometry.transforms import rotation_about
from pipelines.learning.peers.graspnet_labels import LEVELS, STORED_PER_METRE, UNITS, VIEW_CELLS
from pipelines.learning.peers.peer import Arrays
from pipelines.network.peers.graspnet import WIDEST_OPENING, WIDEST_TOLERANCE

MOST_LABELLED = 1024  # labelled points of a frame in a training step


@dataclass(frozen=True)
class LabelledScene:
    """One frame in a training step: n points, p labelled points; camera frame, metres.

    Attributes:
        points: (n, 3) in random order.
        on_object: (n,) whether each point is on an object.
        places: (p, 3) labelled points.
        turns: (p, 300, 3, 3) rotations of hands along each view at angle 0.
        value: (p, 300, 48) ln(1 / friction) of candidates that hold, 0 of others.
        width: (p, 300, 48) width as a share of `WIDEST_OPENING`.
        tolerance: (p, 300, 48) tolerance as a share of `WIDEST_TOLERANCE`.
    """

    points: Tensor
    on_object: Tensor
    places: Tensor
    turns: Tensor
    value: Tensor
    width: Tensor
    tolerance: Tensor

    def to(self, device: torch.device) -> "LabelledScene":
        """Return the cloud on a device."""
        return LabelledScene(*(getattr(self, each.name).to(device) for each in fields(self)))


def labelled_scene(
    frame: Arrays, count: int, rng: np.random.Generator, turn: float
) -> LabelledScene:
    """Return `count` points of a frame and its labels, turned about the table's normal.

    `turn`: radians. Views are those of the turned camera: each of the 300 views of a point has the
    labels of its object's nearest view.
    """
    R = rotation_about(frame["up"].astype(np.float64), turn)
    cloud = frame["cloud"] / UNITS
    middle = cloud.mean(axis=0)
    chosen = drawn_indices(len(cloud), count, rng)
    labelled = np.sort(rng.permutation(len(frame["points"]))[:MOST_LABELLED])
    dense = _dense_cells(frame, labelled)
    turns = R @ frame["turns"].astype(np.float64)
    views, rotations = generate_views().astype(np.float64), view_rotations()[:, 0]
    # (k, 300): the view of each object that is nearest to each view of the camera.
    nearest = np.einsum("vi,kij,wj->kvw", views, turns, views).argmax(axis=2)
    owner = frame["object"][labelled]
    permuted = [each[np.arange(len(labelled))[:, None], nearest[owner]] for each in dense]
    along = np.einsum("kij,kvjl->kvil", turns, rotations[nearest])
    arrays = (
        (cloud[chosen] - middle) @ R.T + middle,
        frame["on_object"][chosen],
        (frame["points"][labelled] - middle) @ R.T + middle,
        along[owner],
        *permuted,
    )
    return LabelledScene(
        *(
            torch.from_numpy(each if each.dtype == bool else each.astype(np.float32))
            for each in arrays
        )
    )


def _dense_cells(frame: Arrays, labelled: NDArray[np.int64]) -> tuple[Singles, ...]:
    """Return value, width and tolerance (p, 300, 48) of the points `labelled` (p,)."""
    place = np.full(len(frame["points"]), -1)
    place[labelled] = np.arange(len(labelled))
    kept = place[frame["point"]] >= 0
    where = place[frame["point"][kept]], *np.divmod(frame["cell"][kept], VIEW_CELLS[1])
    # Candidates with friction 1 hold, although the logarithm gives them the value 0.
    friction = np.minimum(frame["friction"][kept] / LEVELS, 1.0)
    columns = (
        np.log(1.0 / friction),
        frame["width"][kept] / (WIDEST_OPENING * STORED_PER_METRE),
        frame["tolerance"][kept] / (WIDEST_TOLERANCE * STORED_PER_METRE),
    )
    dense = []
    for column in columns:
        array = np.zeros((len(labelled), *VIEW_CELLS), np.float32)
        array[where] = column
        dense.append(array)
    return tuple(dense)
