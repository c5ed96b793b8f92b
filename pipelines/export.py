"""Stage `export`: grasps in the formats of other tools.

Reads   grasps.h5                            of `infer`
Writes  DUMP/scene_NNNN/CAMERA/NNNN.npy      `--to graspnet`: graspnetAPI's rows, camera frame
        DUMP/provenance.json

Frames without grasps have an empty array. Frames that failed have no file, and are named.
"""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.batch import StageReport
from pipelines.configs import ExportConfig
from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.formats import grasps_file
from pipelines.formats.files import atomic_folder, write_npy
from pipelines.formats.graspnet import frame_key
from pipelines.formats.graspnet_dump import DumpedScene
from pipelines.formats.grasps_file import FrameResult, GraspTable
from pipelines.formats.grasps_stream import read_index
from pipelines.formats.gripper_files import gripper_digest, load_gripper
from pipelines.formats.provenance import digest, is_finished, make_stamp, write_sidecar
from pipelines.grasping.grasps import Grasps, to_graspnet
from pipelines.grasping.gripper import Gripper

STAGE = "export"
FORMATS = ("graspnet",)


def run(
    grasps: Path, output: Path, config: ExportConfig, *, overwrite: bool = False
) -> StageReport:
    """Write the grasps of `grasps`, frame by frame, into the folder `output`."""
    started, report = time.monotonic(), StageReport(STAGE)
    if config.to not in FORMATS:
        raise UnknownNameError("format", config.to, FORMATS)
    config = replace(config, gripper=config.gripper or read_index(grasps).gripper)
    gripper = load_gripper(config.gripper)
    inputs = {"grasps": digest(grasps), "gripper": gripper_digest(config.gripper)}
    stamp = make_stamp(STAGE, config, inputs=inputs)
    if is_finished(output, stamp, overwrite=overwrite):
        report.skipped.append(output.name)
        return report
    if output.exists() and not (output / "provenance.json").is_file():
        raise SymgraspError(f"{output} exists and is no export of ours; choose another folder")
    found = grasps_file.read(grasps)
    with atomic_folder(output) as folder:
        for result in found.results():
            _write_frame(folder, result, gripper, report)
        write_sidecar(folder, stamp)
    report.done.append(output.name)
    report.notes[output.name] = (
        f"{len(found.grasps)} grasps in {len(found.frames)} frames; gripper {gripper.name}"
    )
    report.seconds = time.monotonic() - started
    return report


def dump_rows(table: GraspTable, gripper: Gripper) -> NDArray[np.float64]:
    """Return graspnetAPI's rows (n, 17) of a frame's grasps; the score is the rank score.

    The width is the opening of `gripper`, and the finger tips pass the contacts by its reach:
    `from_graspnet(rows, tip_reach=gripper.tip_reach)` gives the grasps back.
    """
    rotation = np.asarray(table.rotation, np.float64)
    u, _, v = np.linalg.svd(rotation)  # stored in single precision
    grasps = Grasps(u @ v, np.asarray(table.translation), np.asarray(table.width))
    opening = gripper.opening(grasps.width)
    return to_graspnet(grasps, table.rank_score, opening=opening, tip_reach=gripper.tip_reach)


def _write_frame(folder: Path, result: FrameResult, gripper: Gripper, report: StageReport) -> None:
    key = frame_key(result.name)
    if key is None:
        report.failed[result.name] = (
            "is no frame of a dataset, a dump has no place for it; run infer on a GraspNet root"
        )
    elif result.status == "failed":
        report.failed[result.name] = f"infer failed on it ({result.message}); it has no file"
    else:
        scene_id, camera, frame_id = key
        scene = DumpedScene(folder / f"scene_{scene_id:04d}" / camera, scene_id, camera)
        write_npy(scene.path(frame_id), dump_rows(result.grasps, gripper))
