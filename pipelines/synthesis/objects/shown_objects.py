"""Refusal to replace objects that scenes of earlier runs show."""

from collections.abc import Collection, Mapping

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import FormatError, StaleOutputError, SymgraspError
from pipelines.frames.graspnet_scene import read_object_ids
from pipelines.runtime.batch import WorkItem
from pipelines.storage.provenance import is_finished


def refuse_to_replace_shown(
    root: GraspNetRoot, models: Mapping[int, WorkItem], made_again: Collection[int]
) -> None:
    """Refuse to replace a model by another if a scene that stays shows it.

    `models`: the work item of each object, by id. `made_again`: ids of the scenes of this run.

    Raises:
        SymgraspError: images and poses of a scene would belong to other objects than `models/`.
    """
    replaced = {object_id for object_id, item in models.items() if _is_another(item)}
    if not replaced or not (root.root / "scenes").is_dir():
        return
    for scene_id in sorted(set(root.scene_ids()) - set(made_again)):
        folder = root.scene_folder(scene_id)
        try:
            shown = replaced & set(read_object_ids(folder / "object_id_list.txt"))
        except SymgraspError:  # the stage that reads a broken scene reports it
            continue
        if shown:
            raise SymgraspError(
                f"{folder} shows object {min(shown):03d}, which would be replaced by another "
                "object; make this scene again too, by --split and --scenes-per-split, or delete it"
            )


def _is_another(item: WorkItem) -> bool:
    """Return whether the target exists with another stamp."""
    try:
        is_finished(item.target, item.stamp)
    except (StaleOutputError, FormatError):
        return True
    return False
