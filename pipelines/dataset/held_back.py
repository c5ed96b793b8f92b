"""Refusal to train on evaluation data, as made by `make dev` and `make sealed`."""

from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError

HELD_BACK_POOLS = frozenset({"wide_similar", "sealed"})  # of `synthesize --families`
TRAINING_POOLS = frozenset({"seen", "wide"})


def refuse_held_back(root: GraspNetRoot) -> None:
    """Raise SymgraspError if all objects of `root` are held back for evaluation.

    A network trained on these objects could not be evaluated on them any more. A root without
    `objects.json`, or with further objects to train on, is not refused.
    """
    path = root.root / "objects.json"
    if not path.is_file():
        return
    pools = {record.pool for record in object_list.read(path)}
    if pools & HELD_BACK_POOLS and not pools & TRAINING_POOLS:
        raise SymgraspError(
            f"{root.root} holds objects that are kept for evaluation ({', '.join(sorted(pools))}), "
            "as of `make dev` and `make sealed`; train on a root of `synthesize --split train`"
        )
