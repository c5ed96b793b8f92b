"""Stage `evaluate --protocol graspnet`: AP of dumped grasps, as graspnetAPI computes it.

Reads   DUMP/scene_NNNN/CAMERA/NNNN.npy   rows (N, 17) of any detector, camera frame
        ROOT/scenes, models               poses, cameras; vertices, meshes, textured.sdf
Writes  report.json                       AP, AP_0.4, AP_0.8 by camera and split
        report.html                       tables, curves, outcomes of the grasps
        report.scenes/                    accuracy (frames, 50, 6) and verdicts, a file per scene

A frame without a file, or with a file without grasp rows, is reported and counts as a frame without
grasps. A scene without a folder does not count; a note names it if the dump has others of its split
and camera. Finished scenes are not evaluated again.
"""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipelines.configs import EvaluateDumpConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SPLITS, scene_name
from pipelines.errors import counted, printable
from pipelines.evaluation.graspnet.dump_verdicts import (
    DUMP_STATUSES,
    read_dump_verdicts,
    scenes_folder,
    write_dump_verdicts,
)
from pipelines.evaluation.graspnet.graspnet_figures import DumpTally, dump_tables
from pipelines.evaluation.graspnet.graspnet_page import dump_page
from pipelines.evaluation.graspnet.graspnet_scenes import score_scene
from pipelines.evaluation.graspnet.graspnet_truth import InputDigests
from pipelines.evaluation.reports import reports
from pipelines.evaluation.reports.tables import Table
from pipelines.grasp_files.exports.graspnet_dump import DumpedScene, dumped_scenes
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, drop_stale, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import real_path, write_text
from pipelines.storage.provenance import Stamp, digest_text, is_finished, make_stamp, refuse_foreign

STAGE = "evaluate"
PROTOCOL = "graspnet"
NAMED = 5  # frames of a scene that a sentence names


@one_run_at_a_time(STAGE, "output")
def run(
    dump: Path, dataset: Path, output: Path, config: EvaluateDumpConfig, options: BatchOptions
) -> StageReport:
    """Evaluate the dump against `dataset`; write `output` and the files next to it."""
    root = GraspNetRoot.finished(dataset)
    scenes = dumped_scenes(dump)
    items = _scene_items(scenes, root, output, config)
    inputs = [item.stamp.inputs for item in items]
    joined = {kind: digest_text("".join(each[kind] for each in inputs)) for kind in inputs[0]}
    stamp = _stamp(config, joined)
    refuse_foreign(output, STAGE)
    is_finished(output, stamp, overwrite=options.overwrite)  # refuses to replace another report
    reports.refuse_other_page(output)
    drop_stale(items, options, scenes_folder(output).glob("[!.]*.npz"))
    report = run_batch(STAGE, items, functools.partial(_evaluate_scene, root, config), options)
    notes = _absent_scenes(scenes, root)
    root.warn_of_lost_cameras()
    finished, left_out = [item for item in items if item.target.exists()], dict(report.failed)
    if finished and not options.dry_run:
        tally = _tally(finished, report, config, notes)
        more: dict[str, Any] = {"accuracy": tally.accuracy(), "scenes": tally.scenes}
        more |= {"failed": left_out, "notes": notes}
        reports.write_report(
            output, tally.rows(), stamp, protocol=PROTOCOL, exact=config.exact, **more
        )
        name = printable(real_path(dump).name)
        page = dump_page(reports.read_report(output), name, report.failed)
        write_text(output.with_suffix(".html"), page)
    report.notes |= notes
    return report


def tables(output: Path) -> list[Table]:
    """Return the tables of a written report."""
    return dump_tables(reports.read_report(output)["rows"])


def _evaluate_scene(root: GraspNetRoot, config: EvaluateDumpConfig, item: WorkItem) -> None:
    (dumped,) = item.arguments
    write_dump_verdicts(item.target, score_scene(root, dumped, config), item.stamp)


def _scene_items(
    scenes: Sequence[DumpedScene], root: GraspNetRoot, output: Path, config: EvaluateDumpConfig
) -> list[WorkItem]:
    """Return one item per scene and camera, stale once its grasps, poses or meshes change."""
    folder, digests, items = scenes_folder(output), InputDigests(root, exact=config.exact), []
    for scene in scenes:
        name = scene_name(scene.scene_id, scene.camera)
        stamp = _stamp(config, digests.of(scene))
        items.append(WorkItem(name, folder / f"{name}.npz", stamp, (scene,)))
    return items


def _absent_scenes(scenes: Sequence[DumpedScene], root: GraspNetRoot) -> dict[str, str]:
    """Return a sentence for each split and camera of which the dump has only some scenes."""
    notes = {}
    for camera in sorted({scene.camera for scene in scenes}):
        dumped = {scene.scene_id for scene in scenes if scene.camera == camera}
        for split in SPLITS:
            known = {files.scene_id for files in root.scenes(camera, split)}
            absent = sorted(known - dumped)
            if absent and known & dumped:
                notes[f"{camera}, {split}"] = (
                    f"{len(absent)} of {len(known)} scenes of the dataset are not in the dump and "
                    f"do not count, for example scene_{absent[0]:04d}"
                )
    return notes


def _stamp(config: EvaluateDumpConfig, inputs: Mapping[str, str]) -> Stamp:
    return make_stamp(f"{STAGE} --protocol {PROTOCOL}", config, inputs=inputs)


def _tally(
    items: Sequence[WorkItem],
    report: StageReport,
    config: EvaluateDumpConfig,
    notes: dict[str, str],
) -> DumpTally:
    """Return the figures of all scenes; add faulty frames to the report, and unknown to `notes`."""
    tally = DumpTally()
    for item in items:
        scene: DumpedScene = item.arguments[0]
        verdicts = read_dump_verdicts(item.target)
        tally.add(item.name, scene.camera, scene.scene_id, verdicts)
        unknown = set(scene.frame_ids) - set(verdicts["frame_id"].tolist())
        if unknown:
            skipped = " or among those of --frame-stride" if config.frame_stride > 1 else ""
            left_out = counted(len(unknown), "dumped frame")
            notes[item.name] = f"left out {left_out} not in the dataset{skipped}"
        faults = verdicts["message"][verdicts["message"] != ""].tolist()
        if faults:
            sentence = _sentence(faults, verdicts["status"].tolist())
            report.failed[item.name] = printable(sentence)
    return tally


def _sentence(faults: Sequence[str], statuses: Sequence[int]) -> str:
    """Return the sentence of a scene with `faults`; `statuses` of all its frames."""
    frames = len(statuses)
    missing, unreadable = (statuses.count(DUMP_STATUSES.index(s)) for s in DUMP_STATUSES[1:])
    strided = missing >= frames / 2
    hint = " (after `infer --frame-stride N`, evaluate with the same option)" if strided else ""
    partial, all_frames = len(faults) - missing - unreadable, counted(frames, "frame")
    counts = [
        (missing, f"{missing} of {all_frames} are missing and count as without grasps{hint}"),
        (unreadable, f"{unreadable} of {all_frames} are unreadable and count as without grasps"),
        (partial, f"{partial} of {all_frames} have rows that are no grasps"),
    ]
    more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
    found = ", ".join(sentence for count, sentence in counts if count)
    return f"{found}: {'; '.join(faults[:NAMED])}{more}"
