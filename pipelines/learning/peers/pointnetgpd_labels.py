"""Labelled hands of PointNetGPD in a frame: grasp labels at points that the camera sees."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import grasp_label_pieces
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.dataset.graspnet.graspnet_views import GRASP_DEPTHS, generate_views, view_rotations
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.peers.darboux import darboux_frames, outward_normals, over_table
from pipelines.grasping.peers.hands import MIN_CLOSED_ON, OPENING, Hands, free_hands, thinned
from pipelines.grasping.scene import MAX_RANGE, SceneCloud
from pipelines.learning.peers.scene_collisions import checked_collisions

BAD, FAIR, GOOD, HINDERED = 0, 1, 2, 3  # classes; hindered hands are not used
MAX_GOOD, MAX_FAIR = 0.2, 0.6  # largest friction coefficient of the class
ROUNDING = 1e-4  # rounding error of a label's friction
NEAREST_VIEWS = 3  # views nearest to the normal at a point; 1 suffices for dense labels
MIN_VISIBLE = 50  # visible points of an object
ON_SURFACE = 0.01  # metres from a labelled point to the visible surface
MOST_OF_A_CLASS = 40  # hands of an object and frame that are kept
POINTS_A_PIECE = 64  # labelled points read at a time
KEPT_OBJECTS = 12


@dataclass(frozen=True)
class LabelledHands:
    """Hands with their classes (n,), camera frame, and the points (m, 3) of all objects."""

    hands: Hands
    kind: NDArray[np.uint8]
    objects: Array


@dataclass(frozen=True)
class _ObjectLabel:
    """The classes (P, 300, 12, 4) of the hands at the points (P, 3) of an object."""

    points: Singles
    kind: NDArray[np.uint8]


def labelled_hands(root: GraspNetRoot, files: FrameFiles) -> LabelledHands:
    """Return some labelled hands of each visible object of a frame, chosen evenly."""
    depth, intrinsics = root.read_depth(files)
    scene = root.scene(files.scene_id, files.camera)
    height = scene.table_from_camera(files.frame_id)[2]
    cloud = SceneCloud(depth.astype(np.float64), intrinsics, Plane(height[:3], float(height[3])))
    sound = (cloud.depth > 0) & (cloud.depth < MAX_RANGE) & ~cloud.stray
    objects, thin = over_table(cloud.xyz[sound], cloud.plane), thinned(cloud.xyz[sound])
    thin_objects, instances = thinned(objects), root.read_label(files)
    found = [(Hands.none(), np.zeros(0, np.uint8))]
    for place, pose in enumerate(root.read_annotation(files)):
        visible = cloud.xyz[sound & (instances == pose.object_id + 1)]
        if len(visible) < MIN_VISIBLE:
            continue
        label = _object_label(root.grasp_label_path(pose.object_id))
        hindered = checked_collisions(root, files, place, len(label.points))
        hands, kind = _hands_at(thinned(visible), label, hindered, pose.T_cam_obj)
        usable = (kind != HINDERED) & free_hands(hands, thin_objects, thin)
        chosen = _some_of_each(hands, kind, np.flatnonzero(usable), objects)
        found.append((hands[chosen], kind[chosen]))
    hands_of, kinds = zip(*found, strict=True)
    columns = (
        np.concatenate([getattr(hands, name) for hands in hands_of])
        for name in ("rotation", "origin", "depth")
    )
    return LabelledHands(Hands.equally_open(*columns), np.concatenate(kinds), objects)


def _hands_at(
    visible: Array, label: _ObjectLabel, hindered: Mask, T_cam_obj: Array
) -> tuple[Hands, NDArray[np.uint8]]:
    """Return the hands at the labelled points near `visible` (n, 3), and their classes.

    A point has hands of the views nearest to its normal, at the angle nearest to the surface's
    Darboux frame, at all depths.
    """
    points = transform_points(T_cam_obj, label.points)
    if len(visible) < MIN_VISIBLE / 10:
        near = np.zeros(0, np.int64)
    else:
        near = np.flatnonzero(cKDTree(visible).query(points)[0] < ON_SURFACE)
    frames = darboux_frames(points[near], visible, outward_normals(visible))
    turn = np.asarray(T_cam_obj)[:3, :3]
    along = -frames[:, :, 0] @ turn @ generate_views().T
    view = np.argsort(-along, axis=1)[:, :NEAREST_VIEWS].reshape(-1)
    near, frames = np.repeat(near, NEAREST_VIEWS), np.repeat(frames, NEAREST_VIEWS, axis=0)
    rotations = turn @ view_rotations()[view].astype(np.float64)  # (m, 12, 3, 3)
    angle = np.abs(np.einsum("maij,mi->maj", rotations, frames[:, :, 1])[..., 1]).argmax(axis=1)
    kind = label.kind[near, view, angle]
    holds = (kind == GOOD) | (kind == FAIR)
    kind = np.where(holds & hindered[near, view, angle], HINDERED, kind)
    depths = len(GRASP_DEPTHS)
    rotation = np.repeat(rotations[np.arange(len(near)), angle], depths, axis=0)
    origin = np.repeat(points[near], depths, axis=0)
    return Hands.equally_open(rotation, origin, np.tile(GRASP_DEPTHS, len(near))), kind.reshape(-1)


def _some_of_each(
    hands: Hands, kind: NDArray[np.uint8], usable: Indices, objects: Array
) -> Indices:
    """Return up to `MOST_OF_A_CLASS` hands of each class that close on enough points."""
    chosen = []
    for each in (BAD, FAIR, GOOD):
        own = usable[kind[usable] == each]
        own = own[np.linspace(0, max(len(own) - 1, 0), min(len(own), MOST_OF_A_CLASS)).astype(int)]
        chosen += [
            i for i in own.tolist() if len(hands.closing_region(i, objects)) >= MIN_CLOSED_ON
        ]
    return np.array(chosen, np.int64)


@lru_cache(maxsize=KEPT_OBJECTS)
def _object_label(path: Path) -> _ObjectLabel:
    """Return the classes of an object's hands from its grasp label.

    A hand that needs a wider opening than `OPENING` is bad. A hand that holds, but collides with
    the object, is hindered; for bad hands the label need not state collisions.
    """
    points, kinds = zip(*_pieces(path), strict=True)
    return _ObjectLabel(np.concatenate(points), np.concatenate(kinds))


def _pieces(path: Path) -> Iterator[tuple[Singles, NDArray[np.uint8]]]:
    for label in grasp_label_pieces(path, POINTS_A_PIECE):
        friction = label.min_friction
        holds = (friction > 0) & (label.offsets[..., 2] <= OPENING)
        kind = np.full(friction.shape, BAD, np.uint8)
        kind[holds & (friction <= MAX_FAIR + ROUNDING)] = FAIR
        kind[holds & (friction <= MAX_GOOD + ROUNDING)] = GOOD
        kind[holds & label.collision] = HINDERED
        yield label.points, kind
