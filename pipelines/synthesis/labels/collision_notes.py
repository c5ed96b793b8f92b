"""Notes on collision labels of scenes that new grasp labels make stale."""

from collections.abc import Iterable

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError, counted


def collision_note(root: GraspNetRoot, relabelled: Iterable[int]) -> str:
    """Return a note on scenes of `root` whose collision labels belong to earlier grasp labels.

    `relabelled`: ids of objects with new labels. The note is empty if no scene is affected.
    """
    if not (root.root / "scenes").is_dir():
        return ""
    objects = set(relabelled)
    stale = [i for i in root.scene_ids() if objects & _objects_with_collisions(root, i)]
    if not stale:
        return ""
    scenes = f"{counted(len(stale), 'scene')} (first scene_{stale[0]:04d})"
    return (
        f"collision_label and rect of {scenes} belong to "
        "the earlier grasp labels and do not fit the new labels; delete them"
    )


def _objects_with_collisions(root: GraspNetRoot, scene_id: int) -> set[int]:
    """Return the objects of a scene's collision labels; empty without such labels."""
    if not root.collision_label_path(scene_id).is_file() or not root.cameras(scene_id):
        return set()
    try:
        return set(root.scene(scene_id).object_ids)
    except SymgraspError:  # the stage that reads a broken scene reports it
        return set()
