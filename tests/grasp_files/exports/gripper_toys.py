"""Random frames of random grasps, and the gripper that they are exported for."""

from dataclasses import replace

import numpy as np

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import random_rotation
from pipelines.grasp_files.exports.export_poses import ExportGripper, PoseFrame
from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps
from pipelines.grasp_files.grasps_tables import FrameResult, RegionTable
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from tests.stages.toy_root import grasp_table

CAMERA = Intrinsics(300.0, 301.0, 7.5, 5.5, 16, 12)
HEADER_STAMP = {"stage": "export", "config": {}, "seed": 0, "inputs": {}, "version": "1"}


def numbered(frame: FrameGrasps, instances: tuple[int, ...]) -> FrameGrasps:
    """The frame as found in the user's masks: `instances` are the ids of its regions."""
    regions = replace(frame.result.regions, instance=instances)
    return replace(frame, result=replace(frame.result, regions=regions))


def random_gripper(rng) -> Gripper:
    lengths = rng.uniform(0.01, 0.05, 6).tolist()
    return Gripper("toy", 0.12, *lengths, 0.01, 0.004, float(rng.uniform(0.1, 0.3)))


def random_result(rng, count: int, name: str = "a/b", regions: int = 3) -> FrameResult:
    """A frame of `count` grasps, sorted by region; the first of each region is its best."""
    rotation = np.array([random_rotation(rng) for _ in range(count)]).reshape(-1, 3, 3)
    grasps = GraspPoses(rotation, rng.normal(size=(count, 3)), rng.uniform(0.01, 0.1, count))
    table = grasp_table(grasps)
    region = np.sort(rng.integers(0, regions, count))
    kept = [c for c in table.SPEC if c not in ("rank_in_frame", "worth_trying")]
    columns = {column: getattr(table, column) for column in kept} | {
        "region": region,
        "rank_score": np.sort(rng.uniform(0, 1, count))[::-1],
        "symmetry_slot": rng.integers(-1, 5, count),
        "is_best": np.isin(np.arange(count), np.unique(region, return_index=True)[1]),
    }
    empty, slots = np.zeros(regions), np.zeros((regions, 5, 3))
    found = RegionTable.from_masks(
        [np.eye(12, 16, i, dtype=bool) for i in range(regions)],
        confidence=empty,
        source=["masks"] * regions,
        symmetry_confidence=slots[:, :, 0],
        symmetry_point=slots,
        symmetry_direction=slots,
        affordance_mean=empty,
        affordance_max=empty,
    )
    status = "ok" if count else "empty"
    return FrameResult(name, status, "", CAMERA, 0.0, found, type(table)(**columns))


def random_frame(rng, count: int, name: str = "a/b") -> tuple[FrameGrasps, ExportHeader]:
    gripper = random_gripper(rng)
    exported = ExportGripper(gripper, gripper.base_to_contacts, "other")
    frame = FrameGrasps.of(random_result(rng, count, name), 100, exported)
    return frame, ExportHeader(exported, PoseFrame(), HEADER_STAMP, {})
