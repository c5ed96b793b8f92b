"""The grasps of one frame, best first over all its regions."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask, Singles
from pipelines.errors import SymgraspError, UnknownNameError, counted
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import nearest_orthogonal
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable
from pipelines.grasping.grasps import CLOSING_ALONG_X, CLOSING_ALONG_Y, GraspPoses, gripper_poses
from pipelines.grasping.gripper import Gripper
from symgrasp.regions import FoundRegion, FoundSymmetry, regions_of

Convention = Literal["closing_y", "closing_x"]
GRASP_COLUMNS = tuple(name for name in GraspTable.SPEC if name != "frame")
BASE_AXES = {"closing_y": CLOSING_ALONG_Y, "closing_x": CLOSING_ALONG_X}


@dataclass(frozen=True, eq=False)
class Grasp:
    """One grasp, camera frame (OpenCV axes), metres.

    Attributes:
        symmetry: the symmetry that gave the second contact; None without a symmetry.
        opening: metres between the open fingers.
        gripper: the gripper of `pose` and `opening`.

    Every other attribute is one row of the attribute of `Grasps` that has the same name.
    """

    region: int
    rotation: Singles
    translation: Singles
    width: float
    contacts: Singles
    affordance: float
    symmetry_slot: int
    source: str
    clearance: float
    enclosed_height: float
    rank_score: float
    ranker: str
    is_best: bool
    rank_in_frame: int
    worth_trying: bool
    symmetry_source: str
    symmetry: FoundSymmetry | None
    opening: float
    gripper: Gripper

    def pose(self, convention: Convention = "closing_y") -> Array:
        """Return the (4, 4) pose of the gripper's base; see `Grasps.poses`."""
        one = self.rotation[None], self.translation[None]
        (pose,) = _base_poses(*one, self.gripper, convention)
        return np.asarray(pose)


@dataclass(frozen=True, eq=False)
class Grasps:
    """The n grasps of one frame, best first over all its regions; read-only.

    An index gives a `Grasp`; a slice, or an array of indices or booleans, gives `Grasps`.
    Camera frame (OpenCV axes: x right, y down, z forward), metres.

    Attributes:
        region: (n,) int32 indices into `regions`.
        rotation: (n, 3, 3) float32, columns approach, closing, approach x closing.
        translation: (n, 3) float32, midpoint of the two contacts.
        width: (n,) float32, distance of the contacts; of a symmetric grasp with the opening margin
            at the second contact, which is estimated.
        contacts: (n, 2, 3) float32, `translation` -+ `width` / 2 along closing.
        affordance: (n,) float32 predicted at the first contact, 0 to 1; 0 if `source` is not
            `network`.
        symmetry_slot: (n,) int32 slot of the symmetry that gave the second contact; -1
            without a symmetry.
        source: (n,) str `network`, `planar`, `random` for the random baseline, or the name of a
            compared method.
        clearance: (n,) float32, scene clearance b of Eq. 8, capped.
        enclosed_height: (n,) float32, enclosed height h of Eq. 8, capped.
        rank_score: (n,) float32, 0 to 1, the order of the grasps: the quality that the grasp
            critic expects, reduced by the torque of the weight and by the probability that the
            region is no object; or s of Eq. 8, reduced in unseen space; or a compared method's own
            score, of any range.
        ranker: (n,) str, source of `rank_score`: `critic`, `eq8`, or `own` for a compared method
            with its own score.
        is_best: (n,) bool, whether the grasp is the first to try of its region.
        rank_in_frame: (n,) int32 place in the order of the frame, 0 for the first grasp to try.
        worth_trying: (n,) bool, whether a critic's `rank_score` is not below the setting
            `weak_below`; True for other rankers.
        symmetry_source: (n,) str, origin of the symmetry: `network`, `shape` or `both`; empty
            without a symmetry.
        regions: all regions of the frame, also those without grasps.
        gripper: the gripper of `poses` and `opening`.
        name: name of the frame, if it comes from a file.
        status: `ok`, `empty` (nothing to grasp), or in a file `failed`.
        message: reason why there are no grasps; with grasps a note, such as on masks that are too
            small, or empty.
        intrinsics: of the depth image; None if the frame could not be read.
    """

    region: NDArray[np.int32]
    rotation: Singles
    translation: Singles
    width: Singles
    contacts: Singles
    affordance: Singles
    symmetry_slot: NDArray[np.int32]
    source: NDArray[np.object_]
    clearance: Singles
    enclosed_height: Singles
    rank_score: Singles
    ranker: NDArray[np.object_]
    is_best: Mask
    rank_in_frame: NDArray[np.int32]
    worth_trying: Mask
    symmetry_source: NDArray[np.object_]
    regions: tuple[FoundRegion, ...]
    gripper: Gripper
    name: str = ""
    status: str = "ok"
    message: str = ""
    intrinsics: Intrinsics | None = None

    def __len__(self) -> int:
        return len(self.width)

    def __iter__(self) -> Iterator[Grasp]:
        return (self[place] for place in range(len(self)))

    @overload
    def __getitem__(self, index: int | np.integer) -> Grasp: ...

    @overload
    def __getitem__(self, index: slice | Mask | NDArray[np.integer] | list[int]) -> "Grasps": ...

    def __getitem__(
        self, index: int | np.integer | slice | Mask | NDArray[np.integer] | list[int]
    ) -> "Grasp | Grasps":
        if isinstance(index, np.ndarray) and index.ndim == 0:
            index = int(index)
        rows = {name: getattr(self, name)[index] for name in GRASP_COLUMNS}
        if isinstance(index, int | np.integer):
            return self._grasp(rows)
        for row in rows.values():
            row.flags.writeable = False
        rest = {each.name: getattr(self, each.name) for each in fields(self)}
        return Grasps(**{**rest, **rows})

    def _grasp(self, row: dict[str, Any]) -> Grasp:
        values = {k: v.item() if isinstance(v, np.generic) else v for k, v in row.items()}
        found = self.regions[row["region"]].symmetries
        return Grasp(
            **values,
            symmetry=next((s for s in found if s.slot == row["symmetry_slot"]), None),
            opening=float(self.gripper.opening(row["width"])),
            gripper=self.gripper,
        )

    @property
    def best(self) -> Grasp:
        """The grasp to try first.

        Raises:
            SymgraspError: there is no grasp; the message gives the reason.
        """
        if not len(self):
            raise SymgraspError(f"there is no grasp: {self._why_none}")
        return self[0]

    @property
    def _why_none(self) -> str:
        return "all were left out" if self.status == "ok" else self.message

    @property
    def symmetries(self) -> tuple[FoundSymmetry, ...]:
        """The symmetries of all regions."""
        return tuple(symmetry for region in self.regions for symmetry in region.symmetries)

    @property
    def opening(self) -> Array:
        """(n,) metres between the open fingers: width and the finger clearance on each side."""
        return self.gripper.opening(self.width)

    def poses(self, convention: Convention = "closing_y") -> Array:
        """Return (n, 4, 4) poses of the gripper's base in the camera frame, float64.

        The base is the mounting face; z is the approach.

        Args:
            convention: `closing_y`, fingers close along y, as for `panda_hand` in MoveIt, ROS and
                Isaac; or `closing_x`, as in Contact-GraspNet and ACRONYM.

        Raises:
            UnknownNameError: the convention is unknown.
        """
        return _base_poses(self.rotation, self.translation, self.gripper, convention)

    def __repr__(self) -> str:
        best = f", best rank_score {self.rank_score[0]:.2f}" if len(self) else f": {self._why_none}"
        return f"Grasps({len(self)} in {counted(len(self.regions), 'region')}{best})"


def ordered_grasps(result: FrameResult, gripper: Gripper) -> Grasps:
    """Return the grasps of a frame in the order of `rank_in_frame`."""
    order = np.argsort(result.grasps.rank_in_frame)
    columns = {name: getattr(result.grasps, name)[order] for name in GRASP_COLUMNS}
    for column in columns.values():
        column.flags.writeable = False
    return Grasps(
        **columns,
        regions=regions_of(result.regions, result.size),
        gripper=gripper,
        name=result.name,
        status=result.status,
        message=result.message,
        intrinsics=result.intrinsics,
    )


def _base_poses(
    rotation: Singles, translation: Singles, gripper: Gripper, convention: Convention
) -> Array:
    if convention not in BASE_AXES:
        raise UnknownNameError("convention", convention, BASE_AXES)
    exact = GraspPoses.unchecked(
        nearest_orthogonal(rotation), translation.astype(np.float64), np.zeros(len(rotation))
    )
    return gripper_poses(exact, gripper.base_to_contacts, BASE_AXES[convention])
