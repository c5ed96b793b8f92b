"""Stage `export`: grasps in the formats of other tools.

Reads   grasps.h5                            of `infer`
Writes  DUMP/scene_NNNN/CAMERA/NNNN.npy      `--to graspnet`: graspnetAPI's rows; DUMP/NAME.npy for
                                             frames outside a dataset, or of several datasets with
                                             the same scenes
        OUT/predictions_NAME.npz             `--to contact-graspnet`
        OUT/NAME.yaml                        `--to isaac`: isaac_grasp files
        OUT/NAME.json                        `--to ros-json`: PoseArray and widths
        OUT.json, OUT.csv                    `--to json`, `--to csv`: all frames in one file

Poses are those of the gripper's base or of its tool centre point, in the camera frame, or in the
robot's base frame if a hand-eye calibration, or the camera's pose in each frame, is given. Frames
without grasps have a file without grasps; failed frames have no file, and are reported. Folders
contain `provenance.json`; the provenance of OUT.csv is in a file next to it, that of OUT.json in
OUT.json.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path

from pipelines.configs import ExportConfig, check_settings
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.frames.cameras.hand_eye import POSE_SUFFIXES
from pipelines.grasp_files.exports import (
    contact_graspnet_predictions,
    grasp_csv,
    grasp_json,
    graspnet_dump,
    isaac_grasps,
    ros_grasps,
)
from pipelines.grasp_files.exports.export_poses import (
    ExportGripper,
    PoseFrame,
    pose_frame_of_each,
    pose_origin,
)
from pipelines.grasp_files.exports.export_tally import ExportTally
from pipelines.grasp_files.exports.grasp_exports import (
    LONGEST_PREFIX,
    LONGEST_SUFFIX,
    Claims,
    ExportHeader,
    FrameGrasps,
    folds_case,
    frame_path,
)
from pipelines.grasp_files.grasps_stream import GraspsIndex, read_index, read_sound
from pipelines.grasp_files.gripper_files import (
    gripper_digest,
    gripper_to_use,
    is_found_for,
    load_gripper,
)
from pipelines.runtime.batch import StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import atomic_folder, remove_file
from pipelines.storage.provenance import (
    Stamp,
    digest,
    digest_tree,
    is_finished,
    make_stamp,
    refuse_foreign,
    sidecar_of,
    write_sidecar,
)

STAGE = "export"
FrameWriter = Callable[[Path, FrameGrasps, ExportHeader], None]
FileWriter = Callable[[Path, Iterable[FrameGrasps], ExportHeader], None]
# Writers, with the prefix and the suffix that turn a frame's name into its file name.
TO_FOLDER: dict[str, tuple[FrameWriter, str, str]] = {
    "graspnet": (graspnet_dump.write_frame, "", ".npy"),
    "contact-graspnet": (contact_graspnet_predictions.write_frame, "predictions_", ".npz"),
    "isaac": (isaac_grasps.write_frame, "", ".yaml"),
    "ros-json": (ros_grasps.write_frame, "", ".json"),
}
STAMP_FILE = Path("provenance.json")  # in a folder
TO_FILE: dict[str, FileWriter] = {"json": grasp_json.write, "csv": grasp_csv.write}
FILE_SUFFIXES = {".json", ".csv", *(suffix for _, _, suffix in TO_FOLDER.values())}


@one_run_at_a_time(STAGE, "output")
def run(
    grasps: Path,
    output: Path,
    config: ExportConfig,
    *,
    camera_to_base: Path | None = None,
    overwrite: bool = False,
) -> StageReport:
    """Write the grasps of `grasps` to the folder `output`, or to the file for json and csv.

    `camera_to_base`: hand-eye calibration, or a folder with the camera's pose in each frame, for
    poses in the robot's base frame.

    Raises:
        SymgraspError: `grasps` or the calibration cannot be read, the format or gripper is not
            known, `output` was made by another program or with other settings, or none of the
            frames can be written.
    """
    started, report = time.monotonic(), StageReport(STAGE)
    check_settings(config)
    _check_options(output, config, in_base=camera_to_base is not None)
    index = read_index(grasps)
    name_or_path = gripper_to_use(config.gripper, index.gripper, index.stamp)
    gripper = _gripper(index, name_or_path, config)
    frame, frame_of = pose_frame_of_each(camera_to_base, config.frame_id, index.names)
    stamp = _stamp(grasps, name_or_path, gripper, config, camera_to_base)
    _refuse_others_work(output)
    finished = is_finished(output, stamp, overwrite=overwrite)
    tally = ExportTally()
    frames = _exported(grasps, index, gripper, frame_of, config.min_score, report)
    path_of = _paths(config.to, index, report)
    if config.to in TO_FOLDER:
        frames = _with_path(frames, path_of, Claims(folds_case=folds_case(output)), index, report)
    frames = tally.counted(frames)
    header = ExportHeader(gripper, frame, stamp.as_json(), index.stamp)
    if finished:
        # All frames are read, so that those that could not be exported are reported again.
        lost = _write_frames(frames, output, path_of, header, config.to)
        (report.done if lost else report.skipped).append(output.name)
        return report
    if config.to in TO_FILE:
        _write_file(output, stamp, lambda path: TO_FILE[config.to](path, frames, header))
    else:
        with atomic_folder(output) as folder:
            _write_frames(frames, folder, path_of, header, config.to)
            write_sidecar(folder, stamp)
    report.done.append(output.name)
    report.notes |= tally.notes(
        output.name, len(index.names) - len(report.failed), gripper, config.min_score
    )
    report.seconds = time.monotonic() - started
    return report


def _check_kind(output: Path, to: str) -> None:
    if to in TO_FILE and (output.suffix != f".{to}" or output.is_dir()):
        raise ValueRangeError("--out", output, f"one file whose name ends in .{to}")
    if to not in TO_FOLDER:
        return
    if output.is_file():
        raise SymgraspError(f"{output} is a file; {to} is written as a folder, choose another")
    if output.suffix.lower() in FILE_SUFFIXES and not output.is_dir():
        expected = f"the name of a folder: --to {to} writes a folder; --to json and csv one file"
        raise ValueRangeError("--out", output, expected)


def _check_options(output: Path, config: ExportConfig, *, in_base: bool) -> None:
    """Check the kind of `output`, and that --frame-id is used: some formats name only a base."""
    _check_kind(output, config.to)
    naming = ("ros-json", "json", "csv", "isaac") if in_base else ("ros-json",)
    if config.frame_id and config.to not in naming:
        expected = f"left out: {config.to} does not name the frame of the poses; ros-json does"
        raise ValueRangeError("--frame-id", config.frame_id, expected)


def _gripper(index: GraspsIndex, name_or_path: str, config: ExportConfig) -> ExportGripper:
    model = load_gripper(name_or_path)
    behind = model.base_to_contacts
    if config.to == "graspnet":  # the origin of its poses is no gripper's base
        behind = model.graspnet_depth - model.tip_reach
    elif config.to == "contact-graspnet" and not config.gripper:  # it has its own gripper
        behind = contact_graspnet_predictions.BASE_TO_CONTACTS
    alike = is_found_for(name_or_path, index.gripper, index.stamp)
    behind, origin = pose_origin(config.tcp, model, behind)
    return ExportGripper(model, behind, index.gripper, alike, origin)


def _stamp(
    grasps: Path,
    name_or_path: str,
    gripper: ExportGripper,
    config: ExportConfig,
    camera_to_base: Path | None,
) -> Stamp:
    settings = {
        **asdict(config),
        "gripper": name_or_path,
        "base_to_contacts": round(gripper.base_to_contacts, 9),
    }
    inputs = {"grasps": digest(grasps), "gripper": gripper_digest(name_or_path)}
    if camera_to_base is not None:
        is_folder = camera_to_base.is_dir()
        inputs["camera_to_base"] = (
            digest_tree(camera_to_base, POSE_SUFFIXES) if is_folder else digest(camera_to_base)
        )
    return make_stamp(STAGE, settings, inputs=inputs)


def _refuse_others_work(output: Path) -> None:
    """Raise SymgraspError if `output` exists and no export wrote it."""
    # A run that was killed before it wrote the stamp leaves a .csv without one.
    if not (output.suffix == ".csv" and output.is_file() and grasp_csv.is_ours(output)):
        refuse_foreign(output, STAGE)


def _exported(
    grasps: Path,
    index: GraspsIndex,
    gripper: ExportGripper,
    frame_of: Callable[[str], PoseFrame],
    min_score: float,
    report: StageReport,
) -> Iterator[FrameGrasps]:
    """Yield the exported grasps frame by frame, one in memory at a time; report failed frames."""
    for _place, first, result in read_sound(grasps, index.names, report.failed):
        if result.status == "failed":
            report.failed[result.name] = f"infer failed on it ({result.message}); it has no grasps"
        try:
            frame = frame_of(result.name) if len(result.grasps) else None
            found = FrameGrasps.of(result, first, gripper, min_score, frame)
        except SymgraspError as error:
            report.failed[result.name] = str(error)
        else:
            yield found
    _refuse_nothing(index, report)


def _write_frames(
    frames: Iterable[FrameGrasps],
    folder: Path,
    path_of: Callable[[str], Path],
    header: ExportHeader,
    to: str,
) -> int:
    """Write the frames that have no file in `folder` yet; return their number."""
    written = 0
    for each in frames:
        path = folder / path_of(each.result.name)
        if not path.is_file():
            TO_FOLDER[to][0](path, each, header)
            written += 1
    return written


def _write_file(output: Path, stamp: Stamp, write: Callable[[Path], None]) -> None:
    has_sidecar = output.suffix == ".csv"  # a JSON file contains its stamp
    if has_sidecar:  # a stamp must never be next to another file
        remove_file(sidecar_of(output))
    write(output)
    if has_sidecar:
        write_sidecar(output, stamp)


def _paths(to: str, index: GraspsIndex, report: StageReport) -> Callable[[str], Path]:
    """Return the function from a frame's name to the path of its file in the folder."""
    if to in TO_FILE:
        return lambda _name: Path()  # the output itself
    if to != "graspnet":
        return lambda name: frame_path(name, *TO_FOLDER[to][1:])
    states = zip(index.names, index.statuses, strict=True)
    shared = graspnet_dump.shared_place(name for name, status in states if status != "failed")
    if shared is not None:  # several datasets: their files must not overwrite each other
        report.notes["names"] = (
            f"{shared[0]} and {shared[1]} would have one file in a dump; so all files are named "
            "like the frames, and each path before scene_NNNN is a separate dump"
        )
    return partial(graspnet_dump.frame_file, by_name=shared is not None)


def _with_path(
    frames: Iterable[FrameGrasps],
    path_of: Callable[[str], Path],
    claims: Claims,
    index: GraspsIndex,
    report: StageReport,
) -> Iterator[FrameGrasps]:
    """Yield the frames with a file name that is valid and unique; report the other frames."""
    claims.claim(STAMP_FILE, "the export's stamp")
    for frame in frames:
        name = frame.result.name
        try:
            frame_path(name, LONGEST_PREFIX, LONGEST_SUFFIX)
            claims.claim(path_of(name), f"that of {name}")
        except SymgraspError as error:
            report.failed[name] = str(error)
        if name not in report.failed:
            yield frame
    _refuse_nothing(index, report)


def _refuse_nothing(index: GraspsIndex, report: StageReport) -> None:
    """Raise SymgraspError if not one frame could be written."""
    if index.names and set(index.names) <= set(report.failed):
        raise SymgraspError(report.why_all_failed("can be exported, nothing is written"))
