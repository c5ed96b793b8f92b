"""Predictions as Contact-GraspNet saves them, without pickles.

OUT/predictions_NAME.npz holds a plain array per key and segment, `pred_grasps_cam/3`, where
Contact-GraspNet has a pickled dict per key (D. 70; formats.md shows how to make the dicts).
Segments are the ids of the user's masks, or without masks regions, counted from 1: 0 is
Contact-GraspNet's background.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps
from pipelines.grasping.grasps import CLOSING_ALONG_X, gripper_poses
from pipelines.storage.array_files import write_npz

# Metres from the origin of the Franka hand to the middle of the finger pads, where the contacts of
# Contact-GraspNet's poses are.
BASE_TO_CONTACTS = 0.1034


def write_frame(path: Path, frame: FrameGrasps, _header: ExportHeader) -> None:
    """Write the file of a frame, predictions_NAME.npz; a frame without grasps has no segment."""
    gripper, segment_of = frame.gripper, _segments(frame)
    columns = {
        "pred_grasps_cam": gripper_poses(frame.grasps, gripper.base_to_contacts, CLOSING_ALONG_X),
        "scores": frame.result.grasps.rank_score.astype(np.float64),
        "contact_pts": frame.grasps.contacts[:, 0],
        "gripper_openings": frame.opening,
        "rank_in_frame": frame.result.grasps.rank_in_frame,
        "worth_trying": frame.result.grasps.worth_trying,
    }
    arrays = {
        f"{key}/{segment}": column[segment_of == segment]
        for key, column in columns.items()
        for segment in np.unique(segment_of).tolist()
    }
    write_npz(path, **arrays, base_to_contacts=np.array(gripper.base_to_contacts))


def _segments(frame: FrameGrasps) -> NDArray[np.int32]:
    """Return the segment (g,) of each grasp; grasps outside of the user's masks are background."""
    has_masks = (frame.result.regions.instance >= 0).any()
    return np.maximum(frame.instances, 0) if has_masks else frame.result.grasps.region + 1
