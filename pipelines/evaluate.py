"""Stage `evaluate`: score the grasps, symmetries and masks of a `grasps.h5` (Sec. IV).

Reads   grasps.h5            of `infer`, run on a dataset in GraspNet-1Billion's layout
        ROOT/scenes, models  poses, labels, cameras, meshes
        ROOT/symmetry        of `annotate-symmetry`: the true symmetries and regions
        ROOT/affordance      of `refine-grasps`: for the oracle row
        success.json         of `simulate`, if given, one per row: the rates of success in physics
        TABLE.json           further tables of text, for the report to show
        NAME.h5              of `infer` with other settings or methods, on the same frames
Writes  report.json          figures by row (ours, each NAME, baselines) and split
        report.html          the same figures as one page: tables, curves, best and worst frames
        report.frames/       the records of the frames, one file per scene

Every visible object of a frame gets one grasp: the best grasp of all regions on the object. An
object without a grasp has quality 0. Finished scenes are not evaluated again. Memory holds one
frame at a time, and a few bytes per prediction for the figures.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from pipelines.configs import EvaluateConfig, IntervalConfig
from pipelines.configs.evaluation import BootstrapUnit
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.evaluation.baselines import Baselines, rows_of
from pipelines.evaluation.frame_scores import score_frame
from pipelines.evaluation.predictions import FramePredictions
from pipelines.evaluation.reports import reports
from pipelines.evaluation.reports.report_files import write_report_files
from pipelines.evaluation.reports.tables import Table, report_tables
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.other_runs import ComparedRuns, frames_by_row
from pipelines.evaluation.runs.records import (
    FrameRecord,
    read_frame_records,
    records_folder,
    write_frame_records,
)
from pipelines.evaluation.truth import TruthReader
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.provenance import (
    is_finished,
    make_stamp,
    refuse_foreign,
    refuse_own_input,
)


@one_run_at_a_time("evaluate", "output")
def run(
    grasps: Path,
    dataset: Path,
    output: Path,
    config: EvaluateConfig,
    options: BatchOptions,
    *,
    others: Sequence[Path] = (),
    baselines: bool = False,
    success: Sequence[Path] = (),
    tables: Sequence[Path] = (),
    unit: BootstrapUnit = IntervalConfig.unit,
    seed: int = 0,
) -> StageReport:
    """Evaluate `grasps` against `dataset`; write `output` and the files next to it.

    `others`: further `grasps.h5` of the same frames, a row of the report each. `baselines`: also
    plan with ground truth, from the boundary, and at random by `seed`. `success`: each a
    `success.json` that `simulate` made of the grasps of a row, with the same gripper, dataset and
    choice of objects. `tables`: JSON files of further tables, shown unchanged. `unit`: of the
    intervals.
    """
    refuse_own_input(output, [*success, *tables])
    runs = ComparedRuns.of(grasps, others, dataset)
    config = replace(config, gripper=runs.gripper(config.gripper))
    depth = load_gripper(config.gripper).graspnet_depth
    settings = {**asdict(config), "baselines": baselines, "graspnet_depth": round(depth, 9)}
    inputs = runs.inputs(config.gripper, baselines=baselines)
    stamp = make_stamp("evaluate", settings, seed=seed, inputs=inputs)
    refuse_foreign(output, "evaluate")
    is_finished(output, stamp, overwrite=options.overwrite)  # refuses to replace another report
    reports.refuse_other_page(output)
    simulated = reports.read_successes(success, stamp)
    notes = reports.incomplete_notes(simulated) | runs.method_notes() | runs.frames_notes()
    notes |= runs.gripper_notes(config.gripper)
    further = [reports.read_table(path) for path in tables]
    items = runs.items(records_folder(output), stamp, options)
    step = functools.partial(_evaluate_scene, dataset, config, baselines)
    report = run_batch("evaluate", items, step, options)
    report.notes |= notes
    finished = [item.target for item in items if item.target.exists()]
    if finished and not options.dry_run:
        report.notes |= write_report_files(
            output,
            map(read_frame_records, finished),
            runs,
            config,
            stamp,
            unit=unit,
            success=simulated,
            failed=report.failed,
            notes=notes,
            tables=further,
        )
    return report


def tables(output: Path) -> list[Table]:
    """Return the tables of a written report."""
    return report_tables(reports.read_report(output))


def evaluate_frame(
    predictions: Mapping[str, FramePredictions],
    reader: TruthReader,
    baselines: Baselines | None,
    seed: int,
) -> FrameRecord:
    """Return the record of one frame, with the rows of `baselines` unless None.

    `predictions`: predictions for the frame by row, including our own row.
    """
    files = reader.root.frame(predictions[OURS].name)
    truth = reader.read(files)
    rows = rows_of(predictions, files, truth, reader.config, baselines, seed)
    gripper = load_gripper(reader.config.gripper)
    return score_frame(predictions, rows, truth, gripper, reader.config)


def _evaluate_scene(
    dataset: Path, config: EvaluateConfig, baselines: bool, item: WorkItem
) -> str | None:
    reader = TruthReader(GraspNetRoot(dataset), config)
    others = Baselines.of(reader, load_gripper(config.gripper)) if baselines else None
    frames = frames_by_row(*item.arguments)
    records = [evaluate_frame(each, reader, others, item.stamp.seed) for each in frames]
    write_frame_records(item.target, records, item.stamp)
    return None
