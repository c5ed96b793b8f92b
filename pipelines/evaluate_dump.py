"""Stage `evaluate --protocol graspnet`: AP of dumped grasps, as graspnetAPI computes it.

Reads   DUMP/scene_NNNN/CAMERA/NNNN.npy   rows (N, 17) of any detector, camera frame
        ROOT/scenes, models               poses, cameras; vertices, meshes, textured.sdf
Writes  report.json                       AP, AP_0.4, AP_0.8 by camera and split
        report.html                       the same as tables
        report.scenes/                    accuracy (frames, 50, 6) and verdicts, a file a scene

A frame without a file, or with one that holds no grasp rows, is named and counts as one without
grasps. Scenes that are finished are not judged again.
"""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipelines.batch import BatchOptions, StageReport, WorkItem, drop_stale, run_batch
from pipelines.configs import EvaluateDumpConfig
from pipelines.evaluation.graspnet_figures import DumpTotals, dump_tables
from pipelines.evaluation.graspnet_inputs import InputDigests
from pipelines.evaluation.graspnet_scenes import judge_scene
from pipelines.evaluation.report_page import html_table, whole_page
from pipelines.evaluation.tables import Table
from pipelines.formats import reports
from pipelines.formats.dump_verdicts import (
    STATUSES,
    read_dump_verdicts,
    scenes_folder,
    write_dump_verdicts,
)
from pipelines.formats.files import write_text
from pipelines.formats.graspnet import SPLITS, GraspNetRoot
from pipelines.formats.graspnet_dump import DumpedScene, dumped_scenes
from pipelines.formats.provenance import Stamp, digest_text, is_finished, make_stamp

STAGE = "evaluate"
PROTOCOL = "graspnet"
NAMED = 5  # frames of a scene that a sentence names


def run(
    dump: Path,
    dataset: Path,
    output: Path,
    config: EvaluateDumpConfig,
    options: BatchOptions,
) -> StageReport:
    """Evaluate the dump against `dataset` and write `output` and what lies beside it.

    Args:
        dump: folder of `scene_NNNN/CAMERA/NNNN.npy`.
        dataset: root of the dataset that its frames are from.
        output: `report.json`.
        config: exact or as the peer.
        options: how the batch is run.
    """
    root = GraspNetRoot(dataset)
    items = _scene_items(dumped_scenes(dump), root, output, config)
    stamp = _stamp(
        config,
        {
            kind: digest_text("".join(item.stamp.inputs[kind] for item in items))
            for kind in items[0].stamp.inputs
        },
    )
    is_finished(output, stamp, overwrite=options.overwrite)  # refuses to replace another report
    drop_stale(items, options)
    report = run_batch(STAGE, items, functools.partial(_evaluate_scene, root, config), options)
    if not options.dry_run:
        finished = [item for item in items if item.target.exists()]
        rows = _figures(finished, report)
        reports.write_report(output, rows, stamp, protocol=PROTOCOL, exact=config.exact)
        body = "".join(map(html_table, dump_tables(rows)))
        title = f"{dump.name} by GraspNet's protocol"
        write_text(output.with_suffix(".html"), whole_page(title, body))
    return report


def tables(output: Path) -> list[Table]:
    """Return the tables of a written report."""
    return dump_tables(reports.read_report(output)["rows"])


def _evaluate_scene(root: GraspNetRoot, config: EvaluateDumpConfig, item: WorkItem) -> str | None:
    (dumped,) = item.arguments
    frames = judge_scene(root, dumped, config)
    write_dump_verdicts(item.target, frames, item.stamp)
    unknown = set(dumped.frame_ids) - {frame.frame_id for frame in frames}
    if unknown:
        return f"{len(unknown)} dumped frames are not in the dataset and do not count"
    return None


def _scene_items(
    scenes: Sequence[DumpedScene], root: GraspNetRoot, output: Path, config: EvaluateDumpConfig
) -> list[WorkItem]:
    """Return one item a scene and camera; other grasps, true poses or meshes make it stale."""
    folder, digests, items = scenes_folder(output), InputDigests(root, exact=config.exact), []
    for scene in scenes:
        name = f"scene_{scene.scene_id:04d}_{scene.camera}"
        stamp = _stamp(config, digests.of(scene))
        items.append(WorkItem(name, folder / f"{name}.npz", stamp, (scene,)))
    return items


def _stamp(config: EvaluateDumpConfig, inputs: Mapping[str, str]) -> Stamp:
    return make_stamp(f"{STAGE} --protocol {PROTOCOL}", config, inputs=inputs)


def _figures(items: Sequence[WorkItem], report: StageReport) -> dict[str, dict[str, Any]]:
    """Return figures by camera and split, scene by scene; frames at fault join the report."""
    totals: dict[str, dict[str, DumpTotals]] = {}
    for item in items:
        scene: DumpedScene = item.arguments[0]
        verdicts = read_dump_verdicts(item.target)
        splits = totals.setdefault(scene.camera, {name: DumpTotals() for name in (*SPLITS, "all")})
        for name, total in splits.items():
            if name == "all" or scene.scene_id in SPLITS[name]:
                total.add(verdicts)
        faults = verdicts["message"][verdicts["message"] != ""].tolist()
        if faults:
            absent = int((verdicts["status"] != STATUSES.index("ok")).sum())
            more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
            report.failed[item.name] = (
                f"{absent} of {len(verdicts['status'])} frames are absent and count as frames "
                f"without grasps: {'; '.join(faults[:NAMED])}{more}"
            )
    return {
        camera: {n: total.figures() for n, total in splits.items() if n != "train" or total.frames}
        for camera, splits in sorted(totals.items())
    }
