"""A part of a frame at any scale, to draw on, with the camera that sees it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.pictures.palette import Color, ColorImage

NEAREST = 0.02  # metres; shapes with a nearer point are not drawn
FIXED_BITS = 3  # OpenCV draws at eighths of a pixel
FARTHEST_PLACE = 1e6  # eighths of a pixel, of drawn places
PixelBox = tuple[int, int, int, int]  # x0, y0, x1, y1 pixels, x1 and y1 exclusive


@dataclass(frozen=True)
class FrameCanvas:
    """A picture (H, W, 3) to draw on, the camera that sees it, and the part of its frame."""

    picture: ColorImage
    camera: Intrinsics
    part: PixelBox

    @classmethod
    def of(
        cls, frame: Frame, part: PixelBox | None = None, width: int | None = None
    ) -> "FrameCanvas":
        """Return the `part` of a frame, all of it if None, scaled to `width` pixels if given."""
        rows, columns = frame.color.shape[:2]
        left, top, right, bottom = part = part or (0, 0, columns, rows)
        across, down, camera = right - left, bottom - top, frame.intrinsics
        width = width or across
        size = width, max(1, round(down * width / across))
        picture = np.ascontiguousarray(frame.color[top:bottom, left:right]).copy()
        if size != (across, down):
            way = cv2.INTER_AREA if width < across else cv2.INTER_CUBIC
            picture = np.asarray(cv2.resize(picture, size, interpolation=way), np.uint8)
        camera = replace(camera, cx=camera.cx - left, cy=camera.cy - top, width=across, height=down)
        return cls(picture, camera.resized(*size), part)

    @property
    def thick(self) -> int:
        """The width of thin lines in pixels."""
        return max(1, round(int(self.picture.shape[1]) / 640))

    @property
    def scale(self) -> Array:
        """Pixels of the picture to a pixel of the frame (2,), across and down."""
        left, top, right, bottom = self.part
        return np.array(self.picture.shape[1::-1]) / (right - left, bottom - top)

    def pixels(self, points: Array) -> NDArray[np.int32] | None:
        """Return (n, 2) fixed-point pixels of `points` (n, 3); None if one is behind the camera."""
        return _fixed(self.camera.project(points)) if (points[:, 2] > NEAREST).all() else None

    def outline(self, mask: Mask, color: Color) -> None:
        """Draw the outline of `mask` (H, W), of the whole frame."""
        contours, _ = cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        lines = [_fixed((each - self.part[:2] + 0.5) * self.scale - 0.5) for each in contours]
        cv2.polylines(self.picture, lines, True, color, self.thick, cv2.LINE_AA, FIXED_BITS)


def _fixed(pixels: Array) -> NDArray[np.int32]:
    """Return `pixels` (..., 2) as OpenCV's fixed-point numbers."""
    scaled = pixels * (1 << FIXED_BITS)
    return np.asarray(np.round(np.clip(scaled, -FARTHEST_PLACE, FARTHEST_PLACE)), np.int32)
