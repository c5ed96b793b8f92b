"""Stage `evaluate`: judge the grasps, symmetries and masks of a `grasps.h5` (Sec. IV).

Reads   grasps.h5            of `infer`, run on a dataset in GraspNet-1Billion's layout
        ROOT/scenes, models  poses, labels, cameras, meshes
        ROOT/symmetry        of `annotate-symmetry`: the true symmetries and regions
        ROOT/affordance      of `refine-grasps`: for the oracle row
Writes  report.json          figures by row (ours, oracle, planar, random) and split
        report.html          the same as tables
        report.frames/       what was found frame by frame, one file a scene

Every visible object of a frame gets one grasp: the best of all regions that lie on it. An object
without a grasp has quality 0. Scenes that are finished are not judged again.
"""

import functools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import EvaluateConfig, InferConfig
from pipelines.errors import StaleOutputError, SymgraspError
from pipelines.evaluation.baselines import Planner
from pipelines.evaluation.figures import report_rows
from pipelines.evaluation.judging import assign_regions, judge_frame
from pipelines.evaluation.predictions import FramePredictions
from pipelines.evaluation.records import FrameRecord, read_records, write_records
from pipelines.evaluation.tables import Table, report_page, report_tables
from pipelines.evaluation.truth import TruthReader
from pipelines.formats import grasps_file, reports
from pipelines.formats.files import write_text
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.grasps_file import FrameResult, GraspsFile
from pipelines.formats.gripper_files import load_gripper
from pipelines.formats.provenance import Stamp, digest, is_finished, make_stamp

DEFAULT_GRIPPER = "rg2"


def run(
    grasps: Path,
    dataset: Path,
    output: Path,
    config: EvaluateConfig,
    options: BatchOptions,
    *,
    baselines: bool = False,
    seed: int = 0,
) -> StageReport:
    """Evaluate `grasps` against `dataset` and write `output` and what lies beside it.

    Args:
        grasps: a `grasps.h5`.
        dataset: root of the dataset that its frames are from.
        output: `report.json`.
        config: thresholds.
        options: how the batch is run.
        baselines: also plan with ground truth, from the boundary, and at random.
        seed: of the baselines' random draws.
    """
    found = grasps_file.read(grasps)
    config = replace(config, gripper=config.gripper or _gripper_used(found))
    settings = {**asdict(config), "baselines": baselines}
    stamp = make_stamp("evaluate", settings, seed=seed, inputs={"grasps": digest(grasps)})
    is_finished(output, stamp, overwrite=options.overwrite)  # refuses to replace another report
    items = _scene_items(found, GraspNetRoot(dataset), output, stamp, options)
    step = functools.partial(_evaluate_scene, dataset, config, baselines)
    report = run_batch("evaluate", items, step, options)
    if not options.dry_run:
        records = [r for item in items if item.target.exists() for r in read_records(item.target)]
        _write_report(output, records, config, stamp)
    return report


def tables(output: Path) -> list[Table]:
    """Return the tables of a written report."""
    return report_tables(reports.read_report(output)["rows"])


def records_folder(output: Path) -> Path:
    """Return where the records of the report `output` lie, one file a scene."""
    return output.with_suffix(".frames")


def evaluate_frame(
    result: FrameResult, reader: TruthReader, planner: Planner | None, seed: int
) -> FrameRecord:
    """Return what is right and wrong about one frame; `planner` adds the baselines."""
    files = reader.root.frame(result.name)
    truth = reader.read(files)
    predictions = FramePredictions.from_result(result)
    owners = assign_regions(predictions.masks, truth, reader.config)
    rows = {"ours": predictions.row}
    if planner is not None:
        rng = np.random.default_rng([seed, files.scene_id, files.frame_id])
        rows |= planner.rows(predictions.masks, owners, files, truth, rng)
    gripper = load_gripper(reader.config.gripper)
    return judge_frame(predictions, owners, rows, truth, gripper, reader.config)


def _evaluate_scene(
    dataset: Path, config: EvaluateConfig, baselines: bool, item: WorkItem
) -> str | None:
    reader = TruthReader(GraspNetRoot(dataset), config)
    planner = Planner(reader, load_gripper(config.gripper), InferConfig()) if baselines else None
    records = [evaluate_frame(r, reader, planner, item.stamp.seed) for r in item.arguments]
    write_records(item.target, records, item.stamp)
    return None


def _scene_items(
    found: GraspsFile, root: GraspNetRoot, output: Path, stamp: Stamp, options: BatchOptions
) -> list[WorkItem]:
    """Return one item a scene and camera, with the frames that `infer` was given."""
    scenes: Mapping[str, list[FrameResult]] = defaultdict(list)
    for result in found.results():
        frame = root.frame(result.name)
        scenes[f"scene_{frame.scene_id:04d}_{frame.camera}"].append(result)
    if not scenes:
        raise SymgraspError("the grasps file holds no frames; run infer on the dataset first")
    folder = records_folder(output)
    items = [
        WorkItem(name, folder / f"{name}.json", stamp, tuple(results))
        for name, results in sorted(scenes.items())
    ]
    _drop_stale(items, options)
    return items


def _drop_stale(items: Sequence[WorkItem], options: BatchOptions) -> None:
    """Remove records made otherwise: without their report they are but an interrupted run's."""
    for item in items:
        try:
            is_finished(item.target, item.stamp)
        except StaleOutputError:
            if not options.dry_run:
                item.target.unlink()


def _write_report(
    output: Path, records: Sequence[FrameRecord], config: EvaluateConfig, stamp: Stamp
) -> None:
    rows = report_rows(records, config.symmetry_thresholds, config.sphere_threshold)
    timed = [r.seconds for r in records if np.isfinite(r.seconds)]
    seconds = float(np.mean(timed)) if timed else None
    reports.write_report(output, rows, stamp, seconds_per_frame=seconds)
    title = f"SymGrasp: evaluation of {len(records)} frames"
    write_text(output.with_suffix(".html"), report_page(title, report_tables(rows)))


def _gripper_used(found: GraspsFile) -> str:
    return str(found.attrs["config"].get("gripper", DEFAULT_GRIPPER))
