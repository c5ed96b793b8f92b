"""Collisions of labelled grasps with the scene, checked against the objects' grasp labels."""

from functools import lru_cache

from pipelines.array_types import Mask
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import read_collision_labels
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.errors import FormatError

KEPT_SCENES = 2
_collisions = lru_cache(maxsize=KEPT_SCENES)(read_collision_labels)


def checked_collisions(root: GraspNetRoot, files: FrameFiles, place: int, num_points: int) -> Mask:
    """Return the collisions (P, 300, 12, 4) of the object at `place` of a frame's annotation.

    `num_points`: P, points of the object's grasp label.

    Raises:
        FormatError: the collision labels belong to other grasp labels.
    """
    path = root.collision_label_path(files.scene_id)
    found = [len(each) for each in _collisions(path)]
    if place >= len(found) or found[place] != num_points:
        count = f"{found[place]} points" if place < len(found) else "no points"
        raise FormatError(
            path,
            f"holds {count} of object {place} of the scene",
            f"its grasp label has {num_points}; make both labels of the same points",
        )
    return _collisions(path)[place]
