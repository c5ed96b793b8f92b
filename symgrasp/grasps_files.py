"""Reading of `grasps.h5`: the grasps of each frame by the frame's name."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pipelines.errors import UnknownNameError
from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.grasp_files.gripper_files import gripper_to_use, load_gripper
from pipelines.grasping.gripper import Gripper
from symgrasp.grasps import Grasps, ordered_grasps


@dataclass(frozen=True)
class FileGrasps(Mapping[str, Grasps]):
    """The frames of a `grasps.h5` in the file's order, each read on demand.

    Attributes:
        path: the file.
        names: names of the frames.
        gripper: gripper of poses and openings.
    """

    path: Path
    names: tuple[str, ...]
    gripper: Gripper

    def __getitem__(self, name: str) -> Grasps:
        if name not in self._places:
            raise UnknownFrameError(f"frame of {self.path}", name, self.names)
        (result,) = read_results(self.path, [self._places[name]])
        return ordered_grasps(result, self.gripper)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self.names)}


class UnknownFrameError(UnknownNameError, KeyError):
    """Error for a frame name that the file does not contain."""


def read_grasps(path: Path | str, gripper: str | Path | Gripper | None = None) -> FileGrasps:
    """Return the frames of a `grasps.h5` that `symgrasp infer` wrote, by name.

    Args:
        path: the file, also of an older version.
        gripper: gripper of poses and openings; None for the gripper that the grasps were found for.

    Raises:
        FormatError: the file is no grasps.h5, or it is damaged.
        SymgraspError: the gripper is unknown, or none is given and the gripper of
            the grasps is gone or changed.
    """
    path, index = Path(path), read_index(Path(path))
    if not isinstance(gripper, Gripper):
        name = "" if gripper is None else str(gripper)
        gripper = load_gripper(gripper_to_use(name, index.gripper, index.stamp))
    return FileGrasps(path, tuple(index.names), gripper)
