"""The user's statements about frames, which count before the files next to the images."""

from dataclasses import dataclass

from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.depth.stated_units import check_units
from pipelines.frames.rgbd import DepthUnits


@dataclass(frozen=True)
class FrameOptions:
    """The user's statements about the frames; None = as stated in the files next to the images."""

    camera: CameraFile | None = None
    depth_units_per_metre: float | None = None
    trust_pickles: bool = False

    def __post_init__(self) -> None:
        check_units("--depth-units-per-metre", self.depth_units_per_metre)

    @property
    def needs_units(self) -> bool:
        """Whether the unit of the depth comes from the files next to the images."""
        in_camera = self.camera and self.camera.units_per_metre
        return not (self.depth_units_per_metre or in_camera)

    def depth_units(
        self, written: float | None = None, usual: float = DepthUnits().integers
    ) -> DepthUnits:
        """Return the unit of the depth, in every layout by the same order of sources.

        Args:
            written: units per metre in the files next to the images, None if they state none.
            usual: units per metre of whole numbers in the layout, if no source states any.

        Returns:
            The unit that the user stated, for floats too; else that in the stated camera's file,
            else `written`, else `usual`, which are for whole numbers: floats are metres, unless
            they are too large for metres and a file states a unit.
        """
        if (stated := self.depth_units_per_metre) is not None:
            return DepthUnits(stated, stated, is_stated=True)
        units = (self.camera and self.camera.units_per_metre) or written
        return DepthUnits(units or usual, far_floats=units)


NOTHING_STATED = FrameOptions()
