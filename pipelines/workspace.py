"""Stage `workspace`: the table frame, the regions, and a box or mask around the regions.

Reads   RGB-D frames in any layout
Writes  OUT/NAME.png          the picture: axes of the table frame, the box, regions by number
        OUT/NAME_mask.png     the same workspace as a mask, white inside, for `infer --workspace`
        OUT/provenance.json

The boxes are printed as options of `infer`, for each frame and for all frames together.
"""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipelines.array_types import Mask
from pipelines.configs import InferConfig, LimitsConfig, WorkspaceConfig
from pipelines.errors import SymgraspError, ValueRangeError, counted
from pipelines.frames.frame_inputs import current_digest
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import FrameSource
from pipelines.grasping.feasibility.workspace_box import WorkspaceBox, suggested_box
from pipelines.grasping.limits import check_limits
from pipelines.inference.observation import Observation, observe
from pipelines.pictures.workspace_pictures import draw_workspace
from pipelines.runtime.batch import StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import atomic_folder
from pipelines.storage.images import write_image
from pipelines.storage.provenance import (
    digest_text,
    is_finished,
    make_stamp,
    refuse_foreign,
    write_sidecar,
)
from pipelines.tabletop.levelling import table_from_camera

STAGE = "workspace"
GEOMETRIC = InferConfig(regions="geometric")


@dataclass
class Workspaces:
    """Boxes by frame; the notes of `report` are the options of each box."""

    report: StageReport = field(default_factory=lambda: StageReport(STAGE))
    boxes: dict[str, WorkspaceBox] = field(default_factory=dict)

    def options(self) -> str | None:
        """Return the options of a box around all boxes; None if their coordinate frames differ."""
        if len({box.frame for box in self.boxes.values()}) != 1:
            return None
        corners = np.array([box.corners for box in self.boxes.values()])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        first = next(iter(self.boxes.values()))
        return replace(first, corners=np.stack([low, high])).options


@one_run_at_a_time(STAGE, "output")
def run(
    frames: Path,
    output: Path,
    config: WorkspaceConfig,
    *,
    stated: FrameOptions = NOTHING_STATED,
    overwrite: bool = False,
) -> Workspaces:
    """Draw workspaces of `frames`, a folder or one file of a frame, into the folder `output`.

    `stated`: camera and unit of all frames, in place of the ones in the files next to them.

    Raises:
        SymgraspError: no frames, none with a workspace, or `output` was made by another program
            or with other settings.
    """
    started, found = time.monotonic(), Workspaces()
    check_limits(LimitsConfig(box=config.box, box_frame=config.box_frame))
    if not config.box and config.box_frame != WorkspaceConfig.box_frame:
        expected = "left out without a box of --workspace"
        raise ValueRangeError("--workspace-frame", config.box_frame, expected)
    sources = find_frames(frames, stated)
    sources = sources[: config.max_frames]
    stamp = make_stamp(STAGE, config, inputs=_inputs(sources, stated))
    refuse_foreign(output, STAGE)
    finished = is_finished(output, stamp, overwrite=overwrite)  # the boxes are printed again
    with nullcontext(output) if finished else atomic_folder(output) as folder:
        for source in sources:
            with found.report.attempting(source.name):
                _draw(source, folder, config, found)
        if not found.boxes:
            raise SymgraspError(found.report.why_all_failed("has a workspace"))
        if not finished:
            write_sidecar(folder, stamp)
    found.report.seconds = time.monotonic() - started
    return found


def _inputs(sources: Sequence[FrameSource], stated: FrameOptions) -> dict[str, str]:
    """Return the digests of all files of the frames, and of what the user states instead."""
    found: dict[str, str] = {}
    for source in sources:
        for path in source.files:
            name = f"{source.name} {path.name}"
            # Colour and depth may have one name, in two folders.
            found[f"{name} in {path.parent.name}" if name in found else name] = current_digest(path)
    if stated != NOTHING_STATED:
        found["overrides"] = digest_text(f"{stated.camera} {stated.depth_units_per_metre}")
    return found


def frame_box(observation: Observation, config: WorkspaceConfig) -> WorkspaceBox:
    """Return the box of a frame: the box of `config`, else a box around the regions.

    Raises:
        SymgraspError: there are no regions, or no support plane for a box in the table frame.
    """
    plane = observation.scene.plane
    if config.box:
        if config.box_frame == "table" and plane is None:
            raise SymgraspError("no support plane is found; give the box in the camera frame")
        in_table = plane is not None and config.box_frame == "table"
        T_box_cam = table_from_camera(plane) if in_table and plane else np.eye(4)
        return WorkspaceBox(np.reshape(config.box, (2, 3)), config.box_frame, T_box_cam)
    if not any(len(cloud) for cloud in observation.clouds):
        raise SymgraspError("no region is found, so there is no workspace; take another frame")
    return suggested_box([cloud.points for cloud in observation.clouds], plane, config.margin)


def _draw(source: FrameSource, folder: Path, config: WorkspaceConfig, found: Workspaces) -> None:
    """Keep the box of a frame, and write the pictures that are not in `folder` yet."""
    frame = source.read()
    observation = observe(frame, GEOMETRIC, np.random.default_rng(0))
    box = frame_box(observation, config)
    masks: Sequence[Mask] = [region.mask for region in observation.regions]
    found.boxes[source.name] = box
    found.report.notes[source.name] = f"{counted(len(masks), 'region')}; {box.options}"
    pictures = [folder / f"{source.name}{suffix}.png" for suffix in ("", "_mask")]
    if all(path.is_file() for path in pictures):
        return
    inside = box.contains(observation.scene.xyz) | (frame.depth <= 0)  # pixels without depth too
    images = draw_workspace(frame, box, inside, masks), inside.astype(np.uint8) * 255
    for path, image in zip(pictures, images, strict=True):
        if not path.is_file():
            # As the camera sees it, since masks are drawn on its images and undistorted with these.
            write_image(path, frame.distorted(image))
