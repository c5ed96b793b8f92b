"""Dumps of grasp detectors as graspnetAPI evaluates them: one array of grasp rows per frame.

DUMP/scene_NNNN/{kinect,realsense}/NNNN.npy     (N, 17), see `grasp_rows`; camera frame

Our rows have the rank score as score and the gripper's opening as width; the finger tips pass the
contacts by the gripper's reach, so `from_graspnet(rows, tip_reach=...)` gives the grasps back.
If frames of several datasets would share a path, files have the names of the frames:
DUMP/ROOT/scenes is the dump of one dataset.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pipelines.dataset.graspnet.graspnet_layout import frame_key
from pipelines.errors import FormatError
from pipelines.frames.graspnet_scene import CAMERAS
from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps, frame_path
from pipelines.grasping.grasps import to_graspnet
from pipelines.storage.array_files import write_npy

WANTED = "DUMP/scene_NNNN/{kinect,realsense}/NNNN.npy is expected"


@dataclass(frozen=True)
class DumpedScene:
    """The dump of one scene seen by one camera."""

    folder: Path
    scene_id: int
    camera: str

    def path(self, frame_id: int) -> Path:
        """Return the path of the grasps of a frame."""
        return self.folder / f"{frame_id:04d}.npy"

    @property
    def frame_ids(self) -> list[int]:
        """The ids of the dumped frames, ascending."""
        return sorted(int(file.stem) for file in self.folder.glob("*.npy") if file.stem.isdecimal())


def dumped_scenes(dump: Path) -> list[DumpedScene]:
    """List the scenes and cameras of a dump, in order.

    Raises:
        FormatError: the folder holds no scenes of a dump.
    """
    found = [
        DumpedScene(scene / camera, int(match[1]), camera)
        for scene in sorted(dump.iterdir())
        if (match := re.fullmatch(r"scene_(\d{4})", scene.name)) is not None
        for camera in CAMERAS
        if (scene / camera).is_dir()
    ]
    if not any(scene.frame_ids for scene in found):
        scenes = (f"{above}/scene_[0-9][0-9][0-9][0-9]" for above in ("*", "*/*"))
        within = sorted(
            path.parent.relative_to(dump).as_posix() for each in scenes for path in dump.glob(each)
        )
        hint = f"; the folder {within[0]} in it holds scenes, give this folder" if within else ""
        raise FormatError(dump, "no dump of a grasp detector", WANTED + hint)
    return found


def frame_file(name: str, *, by_name: bool = False) -> Path:
    """Return the path in a dump where graspnetAPI expects the grasps of the frame `name`.

    A frame outside of a dataset has NAME.npy, which graspnetAPI's GraspGroup reads; with `by_name`
    every frame has NAME.npy.

    Raises:
        SymgraspError: the frame's name leads out of the folder.
    """
    path, key = frame_path(name, "", ".npy"), frame_key(name)
    if key is None or by_name:
        return path
    scene_id, camera, frame_id = key
    return DumpedScene(Path(f"scene_{scene_id:04d}", camera), scene_id, camera).path(frame_id)


def shared_place(names: Iterable[str]) -> tuple[str, str] | None:
    """Return the first two of the frames `names` that share a path in a dump; None if none do."""
    owners: dict[tuple[int, str, int], str] = {}
    for name in names:
        key = frame_key(name)
        if key is None:
            continue
        if key in owners:
            return owners[key], name
        owners[key] = name
    return None


def write_frame(path: Path, frame: FrameGrasps, _header: ExportHeader) -> None:
    """Write the grasps of a frame to `path`, the result of `frame_file`."""
    score, reach = frame.result.grasps.rank_score, frame.gripper.model.tip_reach
    # From the origin to the finger tips; rounded, as -4e-18 at the tips would read as behind them.
    depth = round(frame.gripper.base_to_contacts + reach, 9) + 0.0
    rows = to_graspnet(frame.grasps, score, opening=frame.opening, tip_reach=reach, depth=depth)
    write_npy(path, rows)
