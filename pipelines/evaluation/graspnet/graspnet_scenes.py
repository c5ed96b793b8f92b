"""Scoring of a dumped scene: verdicts on each of its frames."""

import numpy as np

from pipelines.configs import EvaluateDumpConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError
from pipelines.evaluation.graspnet.dump_verdicts import FrameVerdicts
from pipelines.evaluation.graspnet.graspnet_truth import SceneTruth
from pipelines.grasp_files.exports.graspnet_dump import DumpedScene
from pipelines.grasp_files.grasp_rows import GraspRows, read_grasp_rows
from pipelines.grasping.grasps import RowColumn
from pipelines.metrics.graspnet.graspnet_ap import accuracy
from pipelines.metrics.graspnet.graspnet_frames import score_rows

MAX_SKEW = 0.1  # largest error of the entries of a matrix that still counts as a rotation


def score_scene(
    root: GraspNetRoot, dumped: DumpedScene, config: EvaluateDumpConfig
) -> list[FrameVerdicts]:
    """Return the verdicts on a scene's frames, in order: every n-th by `config.frame_stride`.

    If the dataset holds images, a frame with neither an image nor dumped grasps does not count.

    Raises:
        SymgraspError: the dataset lacks the scene, its camera, its models or its poses.
    """
    files = root.scene(dumped.scene_id, dumped.camera)
    truth = SceneTruth.read(root, files, config.exact)
    posed = files.ids_of("annotations")
    if not posed:
        raise SymgraspError(
            f"{files.camera_folder / 'annotations'} holds no poses; NNNN.xml of every frame"
        )
    if images := files.image_ids:
        there = {*images, *dumped.frame_ids}
        posed = [frame_id for frame_id in posed if frame_id in there]
    chosen = posed[:: config.frame_stride]
    return [_score_frame(truth, dumped, i, config) for i in chosen]


def _score_frame(
    truth: SceneTruth, dumped: DumpedScene, frame_id: int, config: EvaluateDumpConfig
) -> FrameVerdicts:
    path = dumped.path(frame_id)
    if not path.is_file():
        return _without_grasps(frame_id, "missing", f"{path} is missing")
    try:
        given = read_grasp_rows(path, max_width=config.clip_width, max_skew=MAX_SKEW)
    except SymgraspError as error:
        return _without_grasps(frame_id, "unreadable", str(error))
    ids, scene = truth.frame(frame_id)
    kept = np.setdiff1d(np.arange(len(given.rows)), list(given.faults))
    scored = score_rows(given.rows[kept], scene)
    return FrameVerdicts(
        frame_id,
        "ok",
        _fault(path.name, given),
        len(given.rows),
        len(given.faults),
        int(given.straightened.sum()),
        accuracy(scored.friction),
        row=kept[scored.index],
        object_id=np.array(ids, np.int64)[scored.owner],
        confidence=given.rows[kept][scored.index, RowColumn.SCORE],
        friction=scored.friction,
        reason=scored.reason,
    )


def _without_grasps(frame_id: int, status: str, message: str) -> FrameVerdicts:
    return FrameVerdicts(frame_id, status, message, 0, 0, 0, accuracy([]))


def _fault(name: str, given: GraspRows) -> str:
    """Return a sentence on the rows of a file that are no grasps; empty if all rows are grasps."""
    if not given.faults:
        return ""
    first = min(given.faults)
    return f"{name}: row {first} {given.faults[first]}, {len(given.faults)} of its rows left out"
