"""Regions of a frame and the symmetries that were found in them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask, Singles
from pipelines.geometry.symmetry import KIND_OF_SLOT, NUM_SLOTS, SymmetryKind
from pipelines.grasp_files.grasps_tables import RegionTable
from pipelines.storage.masks_rle import decode_mask


@dataclass(frozen=True, eq=False)
class FoundSymmetry:
    """One symmetry of a region, camera frame (Sec. III-E).

    Attributes:
        region: index of its region in `Grasps.regions`.
        slot: one of the network's five: 0 to 2 mirror planes, 3 rotation axis, 4 sphere.
        kind: `reflection`, `rotation` or `sphere`.
        existence: 0 to 1, the network's probability that the symmetry is present; nan without it.
        confidence: 0 to 1, its estimated probability after the fit to the seen surface.
        point: (3,) float32 metres, on the plane or the axis, or the sphere's centre.
        direction: (3,) float32 unit, the plane's normal or the axis; nan for a sphere.
    """

    region: int
    slot: int
    kind: SymmetryKind
    existence: float
    confidence: float
    point: Singles
    direction: Singles


@dataclass(frozen=True, eq=False)
class FoundRegion:
    """One region of a frame: an object, or a part of one.

    Attributes:
        box: (4,) float32 pixels x0, y0, x1, y1 of the mask; x1 and y1 are exclusive.
        confidence: 0 to 1, the detector's score; for a region that it did not find, the probability
            of an object by its rating; a constant without a detector.
        source: origin of the region: `detector`, `geometric`, `color` or `masks`; `rest` for the
            grasps of a compared method on no other region.
        status: `measured`; `flat` if its depth is that of the table; `no_depth`.
        symmetries: found symmetries, most confident first.
        affordance_mean: predicted affordance over the region's points, 0 to 1; nan without network.
        affordance_max: largest predicted affordance.
        instance: id of the caller's mask, or its index in a stack of masks; None without masks.
    """

    box: Singles
    confidence: float
    source: str
    status: str
    symmetries: tuple[FoundSymmetry, ...]
    affordance_mean: float
    affordance_max: float
    instance: int | None
    _runs: NDArray[np.uint32]
    _size: tuple[int, int]

    @cached_property
    def mask(self) -> Mask:
        """Mask (H, W) of the region's pixels, in the image without lens distortion."""
        mask = decode_mask(self._runs, *self._size)
        mask.flags.writeable = False
        return mask

    def __repr__(self) -> str:
        found = ", ".join(f"{s.kind} {s.confidence:.2f}" for s in self.symmetries)
        return f"FoundRegion({self.source}, box {self.box.tolist()}, {found or 'no symmetry'})"


def regions_of(table: RegionTable, size: tuple[int, int]) -> tuple[FoundRegion, ...]:
    """Return the regions of a frame; `size` is its width and height."""
    return tuple(_region(table, place, size) for place in range(len(table)))


def _region(table: RegionTable, place: int, size: tuple[int, int]) -> FoundRegion:
    instance = int(table.instance[place])
    start, end = table.mask_start[place : place + 2]
    runs = table.mask_counts[start:end]
    return FoundRegion(
        box=table.box[place],
        confidence=float(table.confidence[place]),
        source=str(table.source[place]),
        status=str(table.status[place]),
        symmetries=_symmetries(table, place),
        affordance_mean=float(table.affordance_mean[place]),
        affordance_max=float(table.affordance_max[place]),
        instance=None if instance < 0 else instance,
        _runs=runs,
        _size=size,
    )


def _symmetries(table: RegionTable, place: int) -> tuple[FoundSymmetry, ...]:
    """Return the symmetries of a region that have a point, most confident first."""
    confidence, point = table.symmetry_confidence[place], table.symmetry_point[place]
    slots = [slot for slot in range(NUM_SLOTS) if np.isfinite(point[slot]).all()]
    return tuple(
        FoundSymmetry(
            place,
            slot,
            KIND_OF_SLOT[slot],
            float(table.existence[place, slot]),
            float(confidence[slot]),
            point[slot],
            table.symmetry_direction[place, slot],
        )
        for slot in sorted(slots, key=lambda slot: -confidence[slot])
    )
