"""Reading of the records of a report or a `success.json`, scene by scene, as an `EvaluatedRun`."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.contents import mapping_in, reading
from pipelines.dataset.graspnet.graspnet_layout import split_or_none
from pipelines.errors import FormatError, MissingInputError, UnknownNameError
from pipelines.evaluation.graspnet.dump_verdicts import read_dump_verdicts, scenes_folder
from pipelines.evaluation.reports import reports
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.paired_runs import MASKS, EvaluatedRun, RunPredictions
from pipelines.evaluation.runs.records import (
    FrameRecord,
    number_key,
    read_frame_records,
    records_folder,
)
from pipelines.evaluation.runs.trial_records import (
    HELD,
    FrameTrials,
    TrialRecord,
    read_trials,
    trials_folder,
)
from pipelines.geometry.symmetry import SYMMETRY_KINDS
from pipelines.metrics.coco_masks import IOU_THRESHOLDS
from pipelines.metrics.graspnet.graspnet_ap import ap_figures
from pipelines.storage.provenance import COMPARED, read_stamp

PRECISIONS = (*(f"symmetry_ap {kind}" for kind in SYMMETRY_KINDS), MASKS)
DEFAULT_ROW = OURS
SUCCESS = "success"


def compared_folders(report: Path) -> list[Path]:
    """Return the existing folders next to `report` that a comparison may read."""
    folders = (records_folder(report), scenes_folder(report), trials_folder(report))
    return [folder for folder in folders if folder.is_dir()]


def read_run(path: Path, name: str, row: str, run: EvaluatedRun | None = None) -> EvaluatedRun:
    """Read the records next to the report `path`, one scene at a time.

    `path`: `report.json`, of a `grasps.h5` or of a dump by GraspNet's protocol; or `success.json`.
    `row`: of the report. Rows of a dump are cameras; DEFAULT_ROW means all cameras. `run`: of other
    frames, to which the frames of a `report.json` of `infer` are added; None for a new run.

    Raises:
        MissingInputError: there are no records.
        FormatError: the records and the report come from different runs.
        UnknownNameError: the report has no row of this name.
    """
    if reports.is_success(path):
        return _read_success(path, name, row)
    report = reports.read_report(path)
    is_dump = report.get("protocol") == "graspnet"
    if row not in report["rows"] and not (is_dump and row == DEFAULT_ROW):
        raise UnknownNameError(f"row of {path}", row, report["rows"])
    folder = scenes_folder(path) if is_dump else records_folder(path)
    scenes = _scenes(folder, "npz" if is_dump else "json", "evaluate")
    run = EvaluatedRun(name, report) if run is None else run
    if is_dump:
        _read_dump(run, path, scenes, "" if row == DEFAULT_ROW else row)
    else:
        _read_records(run, path, mapping_in(report, "provenance"), scenes, row)
    return run


def success_metric(friction: str) -> str:
    """Return the name of the share of simulated trials held at `friction`."""
    return f"{SUCCESS} {friction}"


def friction_of(metric: str) -> float:
    """Return the friction of a name of `success_metric`."""
    return float(metric.removeprefix(SUCCESS))


def _scenes(folder: Path, suffix: str, command: str) -> list[Path]:
    scenes = sorted(folder.glob(f"[!.]*.{suffix}"))
    if not scenes:
        raise MissingInputError(folder, f"symgrasp {command}")
    return scenes


def _read_success(path: Path, name: str, row: str) -> EvaluatedRun:
    """Read the trials next to a `success.json`; count those held at each friction by frame."""
    report = reports.read_success(path)
    rows = [OURS, *mapping_in(report, "baselines")]
    if row not in rows:
        raise UnknownNameError(f"row of {path}", row, rows)
    run, stamp = EvaluatedRun(name, report), mapping_in(report, "provenance")
    with reading(path, "a friction", "numbers, as `simulate` writes them"):
        metrics = [success_metric(number_key(friction)) for friction in report["frictions"]]
    for scene in _scenes(trials_folder(path), "json", "simulate"):
        _check_stamp(scene, path, stamp, COMPARED)
        with reading(scene, "a record", "run simulate again"):
            for frame in read_trials(scene):
                _add_trials(run, frame, frame.rows[row], metrics)
    return run


def _add_trials(
    run: EvaluatedRun, frame: FrameTrials, trials: list[TrialRecord], metrics: list[str]
) -> None:
    held = Counter(
        success_metric(friction)
        for trial in trials
        for friction, outcome in trial.outcomes.items()
        if outcome.reason == HELD
    )
    sums = {metric: float(held[metric]) for metric in metrics}
    truth = (tuple(sorted(trial.object_id for trial in trials)), 0, ())
    run.add(frame.name, frame.split, truth, len(trials), sums)


def _read_records(
    run: EvaluatedRun, path: Path, stamp: Mapping[str, Any], scenes: list[Path], row: str
) -> None:
    keys = _threshold_keys(path, stamp)
    for scene in scenes:
        _check_stamp(scene, path, stamp, COMPARED)
        with reading(scene, "a record", "run evaluate again"):
            for record in read_frame_records(scene):
                if row in record.rows:
                    add_record(run, record, row, keys)


def add_record(run: EvaluatedRun, record: FrameRecord, name: str, keys: Mapping[str, str]) -> None:
    """Add the row `name` of a frame's record to `run`; `keys`: the result of `threshold_keys`."""
    row, masks = record.rows[name], record.masks_of(name)
    symmetries = [row.symmetries.get(kind) for kind in SYMMETRY_KINDS]
    truth = (
        tuple(sorted(verdict.object_id for verdict in row.verdicts)),
        record.masks.num_truth,
        tuple(scored.num_truth for scored in symmetries if scored is not None),
    )
    values = {
        "grasp_quality": [verdict.quality for verdict in row.verdicts],
        "antipodal_score": [verdict.antipodal for verdict in row.verdicts],
        "antipodal_score_region": [verdict.antipodal_region for verdict in row.verdicts],
        "share_held": [float(verdict.reason == "held") for verdict in row.verdicts],
    }
    sums = {name: float(np.sum(each)) for name, each in values.items()}
    if row.accuracy:
        sums |= ap_figures(row.accuracy)
    place = run.add(record.name, record.split, truth, len(row.verdicts), sums)
    for metric, scored in zip(PRECISIONS, (*symmetries, masks), strict=True):
        if scored is None:
            continue  # a method without symmetries or without regions, or an older record
        run.predictions.setdefault(metric, RunPredictions()).add(place, scored, keys[metric])


def _read_dump(run: EvaluatedRun, path: Path, scenes: list[Path], camera: str) -> None:
    """Add the frames of a dump that `camera` saw; if empty, the frames of all cameras."""
    stamp = mapping_in(run.report, "provenance")
    for path_of_scene in scenes:
        _check_stamp(path_of_scene, path, stamp, ("stage", "config"))
        scene, seen_by = path_of_scene.stem.rsplit("_", 1)
        if camera not in ("", seen_by):
            continue
        with reading(path_of_scene, "the record of a scene", "run evaluate again"):
            found, split = read_dump_verdicts(path_of_scene), split_or_none(int(scene[-4:]))
            by_friction = np.asarray(found["accuracy"], np.float64).mean(axis=1)
            for frame_id, accuracy in zip(found["frame_id"].tolist(), by_friction, strict=True):
                name = f"scenes/{scene}/{seen_by}/{frame_id:04d}"
                run.add(name, split, ((), 0, ()), 1, ap_figures(accuracy))


def _check_stamp(scene: Path, path: Path, stamp: Mapping[str, Any], names: tuple[str, ...]) -> None:
    found = read_stamp(scene) or {}
    if any(found.get(name) != stamp.get(name) for name in names):
        expected = "run its command again, so that one run writes both"
        raise FormatError(scene, f"was made in another run than {path.name}", expected)


def _threshold_keys(path: Path, stamp: Mapping[str, Any]) -> dict[str, str]:
    """Return the threshold at which each metric of PRECISIONS is compared: the reported one."""
    try:
        config = stamp["config"]
        dense, sphere = config["symmetry_thresholds"][0], config["sphere_threshold"]
    except (KeyError, IndexError, TypeError) as error:
        expected = "a report of `symgrasp evaluate` is expected"
        raise FormatError(path, "does not state its thresholds", expected) from error
    return threshold_keys(dense, sphere)


def threshold_keys(dense: float, sphere: float) -> dict[str, str]:
    """Return the name of the threshold of each metric of PRECISIONS.

    `dense`: threshold of the dense symmetry error. `sphere`: metres.
    """
    keys = [number_key(sphere if kind == "sphere" else dense) for kind in SYMMETRY_KINDS]
    return dict(zip(PRECISIONS, (*keys, number_key(IOU_THRESHOLDS[0])), strict=True))
