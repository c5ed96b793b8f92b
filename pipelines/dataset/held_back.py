"""Refusal to train on a root that is kept for judging, as `make dev` and `make sealed` make it."""

from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError

HELD_BACK_POOLS = frozenset({"wide_similar", "sealed"})  # of `synthesize --families`
TRAINING_POOLS = frozenset({"seen", "wide"})


def refuse_held_back(root: GraspNetRoot) -> None:
    """Raise SymgraspError if the objects of `root` are kept for judging.

    What was trained on them could not be judged by them any more. A root without `objects.json`, or
    with objects to train on beside them, is not refused.
    """
    path = root.root / "objects.json"
    if not path.is_file():
        return
    pools = {record.pool for record in object_list.read(path)}
    if pools & HELD_BACK_POOLS and not pools & TRAINING_POOLS:
        raise SymgraspError(
            f"{root.root} holds objects that are kept for judging ({', '.join(sorted(pools))}), as "
            "of `make dev` and `make sealed`; train on a root of `synthesize --split train`"
        )
