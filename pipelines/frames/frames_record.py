"""Record of how the frames of a `grasps.h5` were read, by which later stages read them again."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pipelines.contents import json_object, reading
from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.lens import Distortion
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import FrameSource
from pipelines.storage.files import real_path


@dataclass(frozen=True)
class FramesRecord:
    """A folder of frames, and the options stated in place of the files next to them."""

    folder: Path
    stated: FrameOptions = NOTHING_STATED

    def beside(self, output: Path) -> dict[str, Any]:
        """Return the record as JSON; its folder is relative to that of `output`, if possible.

        So both may be moved together, and no folder of the user is named needlessly.
        """
        try:
            folder = os.path.relpath(real_path(self.folder), real_path(output).parent)
        except ValueError:  # on another drive
            folder = str(real_path(self.folder))
        camera, units = self.stated.camera, self.stated.depth_units_per_metre
        return {
            "frames": Path(folder).as_posix(),
            "camera": None if camera is None else asdict(camera),
            "depth_units_per_metre": units,
        }

    @classmethod
    def of(
        cls, grasps: Path, attrs: Mapping[str, Any], folder: Path | None = None
    ) -> "FramesRecord":
        """Return the record in the attributes `attrs` of the file `grasps`.

        Args:
            grasps: the file.
            attrs: as `grasps_stream.read_index` gives them.
            folder: folder of the frames, if they were moved.

        Raises:
            FormatError: nothing is recorded and no folder given, or the folder is gone.
        """
        with reading(grasps, "the record of its frames", "run infer again"):
            stamp = json_object(grasps, attrs.get("provenance", "{}"), "provenance")
            stored = dict(stamp.get("recorded", {}))
            camera = stored.get("camera")
            camera = None if camera is None else _camera(camera)
            stated = FrameOptions(camera, stored.get("depth_units_per_metre"))
            record = cls(real_path(grasps).parent / stored.get("frames", "."), stated)
        if folder is not None:
            return replace(record, folder=folder)
        if "frames" not in stored:
            raise FormatError(grasps, "does not name the folder of its frames", "give --frames")
        if not record.folder.exists():
            found = f"its frames were in {record.folder}, which does not exist"
            raise FormatError(grasps, found, "give --frames")
        return record

    def sources(self) -> dict[str, FrameSource]:
        """Return the frames by name; errors as `find_frames`."""
        return {source.name: source for source in find_frames(self.folder, self.stated)}


def _camera(stored: Mapping[str, Any]) -> CameraFile:
    """Return the camera of the fields `stored`; older files have no distortion."""
    bent = stored.get("distortion", {})
    distortion = Distortion(**{**bent, "coefficients": tuple(bent.get("coefficients", ()))})
    return CameraFile(**{**stored, "distortion": distortion})
