"""`grasps.h5` as grasps of frames, by the frames' names."""

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
    """The frames of a `grasps.h5` in its order, each read when it is asked for.

    Attributes:
        path: the file.
        names: of its frames.
        gripper: of poses and openings.
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
    """A frame was named that the file does not hold."""


def read_grasps(path: Path | str, gripper: str | Path | Gripper | None = None) -> FileGrasps:
    """Return the frames of a `grasps.h5` that `symgrasp infer` wrote, by name.

    Args:
        path: the file; of older versions too.
        gripper: of poses and openings; None for the one that the grasps were found for.

    Raises:
        FormatError: not a grasps.h5, or damaged.
        SymgraspError: the gripper is not known; or it was not given, and theirs is gone.
    """
    path, index = Path(path), read_index(Path(path))
    if not isinstance(gripper, Gripper):
        asked = "" if gripper is None else str(gripper)
        gripper = load_gripper(gripper_to_use(asked, index.gripper, index.stamp))
    return FileGrasps(path, tuple(index.names), gripper)
