"""Reading of `grasps.h5`: the grasps of each frame by the frame's name."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.grasp_files.exports.grasp_exports import ranked_anew, that_fit
from pipelines.grasp_files.grasp_checks import refuse_wrong_grasps
from pipelines.grasp_files.grasps_stream import read_index, read_named
from pipelines.grasp_files.gripper_files import gripper_to_use, load_gripper
from pipelines.grasping.gripper import Gripper
from symgrasp.grasps import Grasps, ordered_grasps


@dataclass(frozen=True)
class FileGrasps(Mapping[str, Grasps]):
    """The frames of a `grasps.h5` in the file's order, each read on demand.

    The file may be written again meanwhile, as by `infer --watch`: a frame of `names` is found at
    its new place, or an error says that it is gone.

    Attributes:
        path: the file.
        names: names of the frames.
        gripper: gripper of poses and openings.
    """

    path: Path
    names: tuple[str, ...]
    gripper: Gripper
    # Settings of the run that wrote the file.
    _config: Mapping[str, Any] = field(repr=False, compare=False)

    def __getitem__(self, name: str) -> Grasps:
        if name not in self._places:
            raise UnknownFrameError(f"frame of {self.path}", name, self.names)
        result = read_named(self.path, name, self._places[name], self._config)
        try:
            refuse_wrong_grasps(result.grasps)
        except SymgraspError as error:
            raise SymgraspError(f"{self.path}, frame {name!r}: {error}") from error
        kept, _ = ranked_anew(result.grasps, that_fit(result.grasps, self.gripper))
        return ordered_grasps(replace(result, grasps=kept), self.gripper)

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
            Grasps wider than it opens are left out, and the others ranked without them; collisions
            are not checked again.

    Raises:
        FormatError: the file is no grasps.h5, or it is damaged.
        SymgraspError: the gripper is unknown, or none is given and the gripper of
            the grasps is gone or changed.
    """
    path, index = Path(path), read_index(Path(path))
    if not isinstance(gripper, Gripper):
        name = "" if gripper is None else str(gripper)
        gripper = load_gripper(gripper_to_use(name, index.gripper, index.stamp))
    return FileGrasps(path, tuple(index.names), gripper, index.attrs["config"])
