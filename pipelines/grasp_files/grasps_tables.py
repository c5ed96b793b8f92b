"""The tables of `grasps.h5`: frames with their status, regions, and grasps.

Camera frame (OpenCV axes), metres, float32. Every table coerces its columns to the file's types
when it is made, so that writing and reading change no value.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Mask
from pipelines.errors import ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.symmetry import NUM_SLOTS
from pipelines.storage.h5_columns import ColumnSpec, ColumnTable, coerce_columns, table_column
from pipelines.storage.masks_rle import box_of_mask, decode_mask, encode_mask
from pipelines.storage.provenance import digest_text

STATUSES = ("ok", "empty", "failed")
REGION_MEASURED, REGION_FLAT, REGION_NO_DEPTH = "measured", "flat", "no_depth"  # statuses
NO_COLUMN = np.zeros(0)
Tables = dict[str, dict[str, NDArray[Any]]]  # columns by group and name


@dataclass(frozen=True, kw_only=True)
class RegionTable(ColumnTable):
    """The r detected regions of a frame, or of a file; all shapes begin with r."""

    frame: NDArray[Any] = table_column((), np.int32)  # index into the frames
    box: NDArray[Any] = table_column((4,), np.float32)  # x0, y0, x1, y1 pixels, x1 and y1 exclusive
    confidence: NDArray[Any] = table_column((), np.float32)  # 0 to 1, see `Region`
    # Existence is the network's probability of each slot, nan without a network; confidence is the
    # probability after the fit. Points in metres, directions unit; nan without a symmetry.
    existence: NDArray[Any] = table_column((NUM_SLOTS,), np.float32)
    symmetry_confidence: NDArray[Any] = table_column((NUM_SLOTS,), np.float32)
    symmetry_point: NDArray[Any] = table_column((NUM_SLOTS, 3), np.float32)
    symmetry_direction: NDArray[Any] = table_column((NUM_SLOTS, 3), np.float32)
    affordance_mean: NDArray[Any] = table_column((), np.float32)  # of the region's points
    affordance_max: NDArray[Any] = table_column((), np.float32)
    source: NDArray[Any] = table_column((), np.object_)  # detector, geometric, color, masks or rest
    status: NDArray[Any] = table_column((), np.object_)  # measured, flat or no_depth
    instance: NDArray[Any] = table_column((), np.int32)  # id in the user's masks, -1 without
    mask_counts: NDArray[Any]  # u4 (sum,) run lengths of all masks, see masks_rle.py
    mask_start: NDArray[Any]  # i8 (r + 1,) start and end of each mask's runs

    def __post_init__(self) -> None:
        coerce_columns(self, self.SPEC, len(self.box))
        start = np.asarray(self.mask_start, dtype=np.int64)
        counts = np.asarray(self.mask_counts, dtype=np.uint32)
        if start.shape != (len(self) + 1,) or start[0] != 0 or start[-1] != len(counts):
            raise ValueRangeError("mask_start", start.shape, f"{len(self) + 1} ascending starts")
        object.__setattr__(self, "mask_start", start)
        object.__setattr__(self, "mask_counts", counts)

    @classmethod
    def from_masks(cls, masks: Sequence[Mask], **columns: ArrayLike) -> "RegionTable":
        """Return the table of one frame's regions, given their masks (H, W) and other `columns`.

        Without these columns `existence` is nan, `status` measured, `instance` -1.
        """
        runs = [encode_mask(mask) for mask in masks]
        usual: dict[str, Any] = {
            "frame": np.zeros(len(masks)),
            "box": [box_of_mask(mask) for mask in masks],
            "existence": np.full((len(masks), NUM_SLOTS), np.nan),
            "status": [REGION_MEASURED] * len(masks),
            "instance": np.full(len(masks), -1),
            "mask_counts": np.concatenate(runs) if runs else NO_COLUMN,
            "mask_start": np.cumsum([0, *map(len, runs)]),
        }
        return cls(**{**usual, **columns})

    @classmethod
    def empty(cls) -> "RegionTable":
        """Return a table of no regions."""
        columns = dict.fromkeys((*cls.SPEC, "mask_counts"), NO_COLUMN)
        return cls(**columns, mask_start=np.zeros(1))

    def __len__(self) -> int:
        return len(self.box)

    def mask(self, region: int, width: int, height: int) -> Mask:
        """Return the mask (H, W) of one region, given the size of its frame."""
        start, end = self.mask_start[region : region + 2]
        return decode_mask(self.mask_counts[start:end], width, height)


@dataclass(frozen=True, kw_only=True)
class GraspTable(ColumnTable):
    """The g grasps of a frame, or of a file; frame and units as in `grasping/grasps.py`."""

    frame: NDArray[Any] = table_column((), np.int32, optional=True)  # as in RegionTable
    region: NDArray[Any] = table_column((), np.int32)  # index into the regions
    rotation: NDArray[Any] = table_column((3, 3), np.float32)  # approach, closing, binormal
    translation: NDArray[Any] = table_column((3,), np.float32)  # metres, midpoint of the contacts
    width: NDArray[Any] = table_column((), np.float32)  # metres, distance of the contacts
    contacts: NDArray[Any] = table_column((2, 3), np.float32)  # metres
    affordance: NDArray[Any] = table_column((), np.float32)  # predicted, 0..1; 0 for planar
    symmetry_slot: NDArray[Any] = table_column((), np.int32)  # of the counterpart, -1 without
    source: NDArray[Any] = table_column((), np.object_)  # network, planar, random or a method
    clearance: NDArray[Any] = table_column((), np.float32)  # metres, b of Eq. 8
    enclosed_height: NDArray[Any] = table_column((), np.float32)  # metres, h of Eq. 8
    rank_score: NDArray[Any] = table_column((), np.float32)  # expected quality, or s of Eq. 8
    ranker: NDArray[Any] = table_column((), np.object_, optional=True)  # critic, eq8 or own
    is_best: NDArray[Any] = table_column((), np.bool_)  # the best grasp of its region
    rank_in_frame: NDArray[Any] = table_column((), np.int32, optional=True)  # 0 = first
    worth_trying: NDArray[Any] = table_column((), np.bool_, optional=True)  # by score
    # network, shape or both; empty without symmetry, or where the source is unknown
    symmetry_source: NDArray[Any] = table_column((), np.object_, optional=True)

    def __post_init__(self) -> None:
        count = len(self.width)
        if len(self.frame) == 0:  # the table of one frame
            object.__setattr__(self, "frame", np.zeros(count))
        for name in ("ranker", "symmetry_source"):
            if len(getattr(self, name)) == 0:  # not known
                object.__setattr__(self, name, np.full(count, "", object))
        if len(self.rank_in_frame) == 0:
            ranks = ranks_in_frame(np.asarray(self.frame), np.asarray(self.rank_score))
            object.__setattr__(self, "rank_in_frame", ranks)
        if len(self.worth_trying) == 0:
            object.__setattr__(self, "worth_trying", np.ones(count, bool))
        coerce_columns(self, self.SPEC, count)

    @classmethod
    def empty(cls) -> "GraspTable":
        """Return a table of no grasps."""
        return cls(**dict.fromkeys(cls.SPEC, NO_COLUMN))

    def __len__(self) -> int:
        return len(self.width)

    def taken(self, index: slice | NDArray[Any]) -> "GraspTable":
        """Return the grasps `index`, in that order."""
        return GraspTable(**{name: getattr(self, name)[index] for name in self.SPEC})


@dataclass(frozen=True, kw_only=True)
class FrameTable(ColumnTable):
    """Name, status and camera of each of f frames."""

    name: NDArray[Any] = table_column((), np.object_)  # relative to the folder given
    status: NDArray[Any] = table_column((), np.object_)  # ok, empty (nothing to grasp) or failed
    message: NDArray[Any] = table_column((), np.object_)  # why it is empty or failed, or a note
    size: NDArray[Any] = table_column((2,), np.int32)  # width, height; 0 where unknown
    intrinsics: NDArray[Any] = table_column((4,), np.float64)  # fx, fy, cx, cy px; nan if unknown
    seconds: NDArray[Any] = table_column((), np.float32)  # time spent

    def __post_init__(self) -> None:
        coerce_columns(self, self.SPEC, len(self.name))


SCHEMA: dict[str, ColumnSpec] = {
    "frames": FrameTable.SPEC,
    "regions": {**RegionTable.SPEC, "mask_counts": ((), np.uint32), "mask_start": ((), np.int64)},
    "grasps": GraspTable.SPEC,
}
NO_FRAMES: Tables = {
    group: {name: np.zeros((0, *shape), dtype) for name, (shape, dtype) in spec.items()}
    for group, spec in SCHEMA.items()
}


@dataclass(frozen=True)
class FrameResult:
    """The results of `infer` on one frame; indices in the tables are local to the frame."""

    name: str
    status: str  # ok, empty or failed
    message: str = ""
    intrinsics: Intrinsics | None = None  # None where the frame could not be read
    seconds: float = 0.0
    regions: RegionTable = field(default_factory=RegionTable.empty)
    grasps: GraspTable = field(default_factory=GraspTable.empty)

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueRangeError("status", self.status, f"one of {STATUSES}")
        region = self.grasps.region
        if ((region < 0) | (region >= len(self.regions))).any():
            found = f"{region.min()} to {region.max()}"
            raise ValueRangeError("region of a grasp", found, f"0 to below {len(self.regions)}")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, (0, 0) where unknown."""
        camera = self.intrinsics
        return (0, 0) if camera is None else (camera.width, camera.height)


def ranks_in_frame(frame: NDArray[Any], rank_score: NDArray[Any]) -> NDArray[np.int32]:
    """Return (g,) the rank of each grasp by score in its frame, 0 for the highest score.

    Args:
        frame: (g,) index of the frame, ascending.
        rank_score: (g,); of grasps with equal scores, the earlier is first.
    """
    order = np.lexsort((-rank_score, frame))
    ranks = np.empty(len(order), np.int32)
    ranks[order] = np.arange(len(order)) - np.searchsorted(frame[order], frame[order])
    return ranks


def are_worth_trying(ranker: NDArray[Any], rank_score: NDArray[Any], least: float) -> Mask:
    """Return (g,) whether `rank_score` (g,) is `least` or more; True unless a critic ranks."""
    return np.asarray((ranker != "critic") | (rank_score >= np.float32(least)))


def result_digest(result: FrameResult) -> str:
    """Return a digest of all results of a frame, without its run time."""
    parts = [repr((result.name, result.status, result.message, result.intrinsics)).encode()]
    for table, group in ((result.regions, "regions"), (result.grasps, "grasps")):
        for name in SCHEMA[group]:
            column = getattr(table, name)
            is_text = column.dtype == object
            parts.append("\0".join(column).encode() if is_text else column.tobytes())
    return digest_text("\n".join(hashlib.sha256(part).hexdigest() for part in parts))


def tables_of(results: Sequence[FrameResult]) -> Tables:
    """Return the columns of `results` in order, by group; indices count over all results."""
    return joined_tables([_tables_of_frame(result) for result in results])


def _tables_of_frame(result: FrameResult) -> Tables:
    camera = result.intrinsics
    frame: dict[str, Any] = {
        "name": [result.name],
        "status": [result.status],
        "message": [result.message],
        "size": [result.size],
        "intrinsics": [(camera.fx, camera.fy, camera.cx, camera.cy) if camera else (np.nan,) * 4],
        "seconds": [result.seconds],
    }
    tables = {"frames": FrameTable(**frame), "regions": result.regions, "grasps": result.grasps}
    return {
        group: {name: getattr(table, name) for name in SCHEMA[group]}
        for group, table in tables.items()
    }


def joined_tables(tables: Sequence[Tables]) -> Tables:
    """Return the columns of all frames in order; indices count over all frames."""
    counted = (("regions", "frame"), ("grasps", "frame"), ("regions", "mask_counts"))
    counts = np.array([[len(t[group][name]) for group, name in counted] for t in tables], np.int64)
    counts = counts.reshape(-1, len(counted))
    num_regions, num_grasps, _ = counts.T
    first_region, _, first_run = (np.cumsum(counts, axis=0) - counts).T
    result = {
        group: {n: np.concatenate([none, *(t[group][n] for t in tables)]) for n, none in of.items()}
        for group, of in NO_FRAMES.items()
    }
    places = np.arange(len(tables), dtype=np.int32)
    regions, grasps = result["regions"], result["grasps"]
    regions["frame"], grasps["frame"] = (np.repeat(places, n) for n in (num_regions, num_grasps))
    grasps["region"] += np.repeat(first_region, num_grasps)
    starts = [t["regions"]["mask_start"][1:] for t in tables]
    regions["mask_start"] = np.concatenate([np.zeros(1, np.int64), *starts])
    regions["mask_start"][1:] += np.repeat(first_run, num_regions)
    return result
