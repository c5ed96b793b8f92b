"""Updates of `objects.json`, the list of a synthesized root's objects, over several runs."""

from collections.abc import Sequence

from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.object_list import ObjectRecord
from pipelines.storage.provenance import make_stamp


def add_to_object_list(
    root: GraspNetRoot, records: Sequence[ObjectRecord], *, count: int, seed: int
) -> None:
    """Write ROOT/objects.json: `records`, and earlier records of other objects with models.

    `count`: objects per pool and `seed`: of the run, both for the stamp.
    """
    path = root.root / "objects.json"
    earlier = object_list.read(path) if path.is_file() else []
    listed = {each.object_id: each for each in earlier if root.model_path(each.object_id).is_file()}
    listed |= {each.object_id: each for each in records}
    settings = {"pools": sorted({each.pool for each in listed.values()}), "count": count}
    stamp = make_stamp("synthesize object list", settings, seed=seed)
    object_list.write(path, list(listed.values()), stamp)
