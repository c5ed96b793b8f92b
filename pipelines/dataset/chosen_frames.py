"""Selection of frames of a folder: by split, camera, and every N-th frame."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from pipelines.dataset.graspnet.graspnet_layout import SPLITS, scenes_of_split
from pipelines.errors import UnknownNameError, ValueRangeError
from pipelines.frames.graspnet_scene import CAMERAS
from pipelines.frames.rgbd import FrameSource


@dataclass(frozen=True)
class ChosenFrames:
    """Selection of frames of a folder; by default all frames.

    Attributes:
        split: split of GraspNet's scenes, one of SPLITS; None for all.
        camera: camera of GraspNet's scenes, one of CAMERAS; None for both.
        stride: N to select every N-th frame of each folder.
    """

    split: str | None = None
    camera: str | None = None
    stride: int = 1

    def __post_init__(self) -> None:
        if self.split is not None and self.split not in SPLITS:
            raise UnknownNameError("split", self.split, (*SPLITS, "all"))
        if self.camera is not None and self.camera not in CAMERAS:
            raise UnknownNameError("camera", self.camera, CAMERAS)
        if self.stride < 1:
            raise ValueRangeError("--frame-stride", self.stride, "1 or more")

    @property
    def scenes(self) -> frozenset[int] | None:
        """Numbers of the scenes of the split."""
        return None if self.split is None else frozenset(scenes_of_split(self.split))

    def of(self, sources: Sequence[FrameSource]) -> list[FrameSource]:
        """Return every `stride`-th frame of each folder, in order."""
        seen: dict[str, int] = defaultdict(int)
        chosen = []
        for source in sources:
            folder = source.name.rpartition("/")[0]
            if seen[folder] % self.stride == 0:
                chosen.append(source)
            seen[folder] += 1
        return chosen


ALL_FRAMES = ChosenFrames()
