"""Labels of GraspNet's baseline in a frame: candidates that hold at visible points."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from pipelines.array_types import Array, Mask, Singles
from pipelines.configs.peers import PeerNetworkConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import grasp_label_pieces
from pipelines.dataset.graspnet.graspnet_labels import LABEL_GRID
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.peers.cloud_box import boxed_points
from pipelines.grasping.scene import SceneCloud
from pipelines.learning.peers.peer import Arrays, storable
from pipelines.learning.peers.scene_collisions import checked_collisions

UNITS = 10_000.0  # units per metre of stored points
STORED_PER_METRE = 1000.0  # units per metre of stored widths and tolerances
LEVELS = 100.0  # units of stored friction coefficients, per 1
MAX_WIDTH = 0.1  # metres, the widest that a seed can predict
NEAR_SURFACE = 0.01  # metres from a labelled point to the nearest visible point
FEWEST_SEEN = 50  # visible points of an object
LEAST_KEPT, KEPT_SHARE = 300, 0.25  # a frame keeps this many, or share of, an object's points
TOLERANCE_STEPS = np.arange(0.005, 0.051, 0.005)  # metres
HOLDING_SHARE, HOLDING_FRICTION = 0.8, 0.55  # least share of points, largest friction
DENSE_POINTS = 400  # labelled points that an object needs for its tolerances to be measured
STREAMED_POINTS = 64  # labelled points read at a time
KEPT_LABELS = 40
CELLS = int(np.prod(LABEL_GRID))  # candidates at a point
COLUMNS = {
    "object": np.int16,
    "point": np.int32,
    "cell": np.int32,
    "friction": np.uint8,
    "width": np.uint8,
    "tolerance": np.uint8,
}
VIEW_CELLS = (LABEL_GRID[0], CELLS // LABEL_GRID[0])  # views, angles times depths


@dataclass(frozen=True)
class HoldingCells:
    """Candidates of an object that hold: n of them, at P labelled points.

    Attributes:
        points: (P, 3) metres, object frame.
        point: (n,) index of the labelled point.
        cell: (n,) index of view, angle and depth, 0 to 14,399.
        friction: (n,) hundredths.
        width: (n,) millimetres.
        tolerance: (n,) millimetres.
    """

    points: Singles
    point: NDArray[np.int32]
    cell: NDArray[np.int32]
    friction: NDArray[np.uint8]
    width: NDArray[np.uint8]
    tolerance: NDArray[np.uint8]


def graspnet_frame_arrays(
    root: GraspNetRoot, files: FrameFiles, config: PeerNetworkConfig | None = None
) -> Arrays:
    """Return the cloud of a frame and its labels, camera frame.

    `cloud` (n, 3) int16 tenths of a millimetre, `on_object` (n,), `up` (3,) of the table;
    `turns` (k, 3, 3) of the objects; `points` (p, 3) metres and `object` (p,) of labelled points;
    `point`, `cell`, `friction`, `width`, `tolerance` of candidates, as in `HoldingCells`.
    """
    depth, intrinsics = root.read_depth(files)
    height = root.scene(files.scene_id, files.camera).table_from_camera(files.frame_id)[2]
    scene = SceneCloud(depth.astype(np.float64), intrinsics, Plane(height[:3], float(height[3])))
    instances = root.read_label(files)
    boxed = boxed_points(scene) & storable(scene.xyz)
    cloud = scene.xyz[boxed]
    found: list[Arrays] = []
    turns: list[Array] = []
    count = 0
    for place, pose in enumerate(root.read_annotation(files)):
        visible = scene.xyz[boxed & (instances == pose.object_id + 1)]
        if len(visible) < FEWEST_SEEN:
            continue
        label = holding_cells(root.grasp_label_path(pose.object_id))
        hindered = checked_collisions(root, files, place, len(label.points))
        part = _seen_part(label, visible, hindered, pose.T_cam_obj)
        part["object"] = np.full(len(part["points"]), len(turns), np.int16)
        part["point"] = part["point"] + count
        count += len(part["points"])
        turns.append(np.asarray(pose.T_cam_obj)[:3, :3])
        found.append(part)
    return _joined_parts(found) | {
        "cloud": np.round(cloud * UNITS).astype(np.int16),
        "on_object": instances[boxed] > 0,
        "up": height[:3].astype(np.float32),
        "turns": np.array(turns, np.float32).reshape(-1, 3, 3),
    }


def _joined_parts(parts: Sequence[Arrays]) -> Arrays:
    """Return the labels of all objects of a frame in one; without objects, empty arrays."""
    empty: Arrays = {name: np.zeros(0, kind) for name, kind in COLUMNS.items()}
    empty["points"] = np.zeros((0, 3), np.float32)
    return {name: np.concatenate([each[name] for each in [empty, *parts]]) for name in empty}


def _seen_part(label: HoldingCells, visible: Array, hindered: Mask, T_cam_obj: Array) -> Arrays:
    """Return the arrays of labelled points near `visible` (n, 3), without `hindered` candidates.

    `hindered`: (P, 300, 12, 4) collisions in the scene.
    """
    points = transform_points(T_cam_obj, label.points)
    near = np.flatnonzero(cKDTree(visible).query(points)[0] < NEAR_SURFACE)
    most = max(LEAST_KEPT, int(KEPT_SHARE * len(points)))
    kept = min(len(near), most)
    near = near[np.arange(kept) * len(near) // max(1, kept)]
    place = np.full(len(points), -1, np.int32)
    place[near] = np.arange(len(near))
    free = ~hindered.reshape(len(points), CELLS)[label.point, label.cell]
    chosen = free & (place[label.point] >= 0)
    cells = {
        name: getattr(label, name)[chosen] for name in ("cell", "friction", "width", "tolerance")
    }
    return {"points": points[near].astype(np.float32), "point": place[label.point[chosen]], **cells}


@lru_cache(maxsize=KEPT_LABELS)
def holding_cells(path: Path) -> HoldingCells:
    """Return the candidates of a grasp label that hold and do not collide with the object."""
    points, columns = zip(*_streamed(path), strict=True)
    point, cell, friction, width = (np.concatenate(each) for each in zip(*columns, strict=True))
    places = np.concatenate(points)
    tolerance = tolerances(places, point, cell, friction)
    stored = np.round(tolerance * STORED_PER_METRE).astype(np.uint8)
    return HoldingCells(places, point, cell, friction, width, stored)


def _streamed(path: Path) -> Iterator[tuple[Singles, tuple[NDArray[np.number], ...]]]:
    start = 0
    for label in grasp_label_pieces(path, STREAMED_POINTS):
        opening = label.offsets[..., 2]
        holds = (label.min_friction > 0) & ~label.collision & (opening <= MAX_WIDTH)
        point, cell = np.nonzero(holds.reshape(len(holds), CELLS))
        friction = np.round(label.min_friction[holds] * LEVELS).astype(np.uint8)
        width = np.round(opening[holds] * STORED_PER_METRE).astype(np.uint8)
        yield label.points, (
            (point + start).astype(np.int32), cell.astype(np.int32), friction, width,
        )  # fmt: skip
        start += len(label.points)


def tolerances(
    points: Singles, point: NDArray[np.int32], cell: NDArray[np.int32], friction: NDArray[np.uint8]
) -> Array:
    """Return (n,) the radius in metres about each candidate's point within which most points hold.

    It is the largest radius if the points are too few to measure it.

    Args:
        points: (P, 3) metres.
        point: (n,) labelled point of each candidate.
        cell: (n,) index of the candidate's view, angle and depth.
        friction: (n,) hundredths.
    """
    if len(points) < DENSE_POINTS:
        return np.full(len(point), TOLERANCE_STEPS[-1])
    good = np.flatnonzero(friction <= HOLDING_FRICTION * LEVELS)
    ones = np.ones(len(good), np.float32)
    well = csr_array((ones, (point[good], cell[good])), shape=(len(points), CELLS))
    away = np.linalg.norm(points[:, None] - points, axis=-1)
    found, holding = np.zeros(len(point)), np.ones(len(point), bool)
    for radius in TOLERANCE_STEPS:
        within = (away <= radius).astype(np.float32)
        counted = (csr_array(within) @ well).toarray()
        share = counted[point, cell] / within.sum(axis=1)[point]
        holding &= share >= HOLDING_SHARE
        found[holding] = radius
    return found
