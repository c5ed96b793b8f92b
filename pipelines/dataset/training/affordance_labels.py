"""`affordance/NNN.h5`: an object's symmetric contact pairs and the affordance of its surface.

All arrays are in the object's canonical frame, metres. Attributes `num_*`: `RefinementCounts`.
"""

from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.stale_labels import refuse_labels_of_another
from pipelines.storage.files import existing
from pipelines.storage.h5_columns import (
    ColumnTable,
    check_version,
    coerce_columns,
    read_columns,
    table_column,
    write_columns,
)
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import FileVersion, Stamp

FORMAT_VERSION = 1
UNITS = {"contacts": "m", "points": "m"}


@dataclass(frozen=True)
class RefinementCounts:
    """Counts of `refine-grasps` for one object."""

    num_labelled: int = 0  # candidates that hold, without collision with the object
    num_distinct: int = 0  # distinct contact pairs of these candidates on the mesh
    num_originals: int = 0  # kept pairs of these, the first rows
    num_copies: int = 0  # following rows: images of originals under symmetries
    num_dropped: int = 0  # images that missed the surface or do not hold
    num_points_before: int = 0  # surface points with an affordance from the originals alone
    num_points_after: int = 0  # surface points with an affordance from all rows


@dataclass(frozen=True)
class AffordanceLabels(ColumnTable):
    """Refined grasps as m contact pairs, and the affordance of the surface at p points (D. 9)."""

    contacts: NDArray[Any] = table_column((2, 3), np.float32)  # (m,) metres
    approach: NDArray[Any] = table_column((3,), np.float32)  # (m,) unit
    quality: NDArray[Any] = table_column((), np.float32)  # (m,) 1 - least friction, 0..1
    points: NDArray[Any] = table_column((3,), np.float32)  # (p,) metres, surface samples
    normals: NDArray[Any] = table_column((3,), np.float32)  # (p,) unit, outward
    affordance: NDArray[Any] = table_column((), np.float32)  # (p,) 0..1
    counts: RefinementCounts = RefinementCounts()

    def __post_init__(self) -> None:
        coerce_columns(self, PAIR_COLUMNS, len(self.quality))
        coerce_columns(self, SURFACE_COLUMNS, len(self.affordance))


PAIR_COLUMNS, SURFACE_COLUMNS = (
    {name: AffordanceLabels.SPEC[name] for name in names}
    for names in (("contacts", "approach", "quality"), ("points", "normals", "affordance"))
)


def write(path: Path, labels: AffordanceLabels, stamp: Stamp) -> None:
    """Write `labels`; same labels and stamp, same bytes."""
    with new_h5(path) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["frame"] = "object"
        file.attrs["provenance"] = stamp.as_text()
        file.attrs.update(asdict(labels.counts))
        write_columns(file, {name: getattr(labels, name) for name in labels.SPEC}, UNITS)


def current_path(root: GraspNetRoot, object_id: int) -> Path:
    """Return the path of an object's affordance of its present mesh and symmetries.

    Raises:
        MissingInputError: `refine-grasps` has not been run.
        FormatError: mesh or symmetries have changed since.
    """
    path = existing(root.affordance_path(object_id), "symgrasp refine-grasps")
    sources = {"mesh": root.model_path(object_id), "symmetry": root.symmetry_path(object_id)}
    for name, source in sources.items():
        _check_source(name, FileVersion.of(source), FileVersion.of(path))
    return path


@lru_cache(maxsize=512)
def _check_source(name: str, source: FileVersion, labels: FileVersion) -> None:
    cure = "run refine-grasps with --overwrite"
    refuse_labels_of_another(name, source.path, labels.path, cure)


def read(path: Path) -> AffordanceLabels:
    """Read a file of `write`."""
    with open_h5(path) as file:
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        pairs, surface = (read_columns(path, file, s) for s in (PAIR_COLUMNS, SURFACE_COLUMNS))
        # Older files have no counts.
        names = [field.name for field in fields(RefinementCounts)]
        counts = RefinementCounts(**{name: int(file.attrs.get(name, 0)) for name in names})
    return AffordanceLabels(**pairs, **surface, counts=counts)


def read_surface(path: Path) -> dict[str, NDArray[Any]]:
    """Read only `points`, `normals` and `affordance` of the surface, without the many pairs."""
    with open_h5(path) as file:
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        return read_columns(path, file, SURFACE_COLUMNS)
