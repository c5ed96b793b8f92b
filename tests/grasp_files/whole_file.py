"""Reader of a `grasps.h5` as its tables, all frames together."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.grasp_files.grasps_tables import (
    FrameResult,
    FrameTable,
    GraspTable,
    RegionTable,
    tables_of,
)


@dataclass(frozen=True)
class WholeFile:
    results: list[FrameResult]
    frames: FrameTable
    regions: RegionTable
    grasps: GraspTable
    attrs: dict[str, Any]


def read_whole(path: Path) -> WholeFile:
    index = read_index(path)
    results = list(read_results(path, range(len(index.names))))
    tables = tables_of(results)
    frames, regions = FrameTable(**tables["frames"]), RegionTable(**tables["regions"])
    return WholeFile(results, frames, regions, GraspTable(**tables["grasps"]), dict(index.attrs))
