"""The points of the robustness curves: cameras, and edits of the images that leave the truth as is.

Each point differs in one thing from the usual camera `Point()`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import make_pose, rotation_about
from pipelines.synthesis.scenes.cameras import LENSES, direction_at
from pipelines.synthesis.scenes.depth_sensors import SENSORS
from pipelines.synthesis.scenes.tables import View

EditedColor = NDArray[np.uint8]
Edit = Callable[
    [View, np.random.Generator], tuple[EditedColor, Array]
]  # colour (H, W, 3), depth (H, W)

FIELD_OF_VIEW = float(np.degrees(2.0 * np.arctan(640.0 / LENSES["realsense"][0])))
MIN_VISIBLE = 300  # pixels of an object that counts, by the usual camera
PATCH = 8.0  # pixels, size of the patches without depth


@dataclass(frozen=True)
class Point:
    """A camera, and an edit of its images."""

    distance: float = 0.65  # metres to the middle of the objects
    elevation: float = 50.0  # degrees above the table's plane
    size: tuple[int, int] = (640, 480)  # pixels
    field_of_view: float = FIELD_OF_VIEW  # degrees, of the longer side
    roll: float = 0.0  # degrees
    sensor: str = "realsense"
    edit: Edit | None = None

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics with the principal point in the middle."""
        width, height = self.size
        focal = max(self.size) / 2 / np.tan(np.radians(self.field_of_view) / 2)
        return Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    @property
    def min_visible_pixels(self) -> int:
        """Pixels that show the area which `MIN_VISIBLE` pixels of the usual camera show."""
        usual = Point()
        nearer = usual.distance / self.distance
        enlarged = self.intrinsics.fx / usual.intrinsics.fx * nearer
        return max(1, round(MIN_VISIBLE * enlarged**2))

    def pose(self, target: Array, azimuth: float) -> Array:
        """Return T_table_cam (4, 4) of the camera that looks at `target` (3,) from `azimuth`."""
        back = direction_at(azimuth, np.radians(self.elevation))
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])  # also if it looks straight down
        rotation = np.stack([right, np.cross(-back, right), -back], -1)
        turned = rotation @ rotation_about([0, 0, 1], np.radians(self.roll))
        return make_pose(turned, target + self.distance * back)


def noisier(view: View, rng: np.random.Generator, *, factor: float) -> tuple[EditedColor, Array]:
    """Add noise of the sensor's kind, so that its standard deviation is `factor` times larger."""
    constant, quadratic = SENSORS["realsense"].axial
    noise = cv2.GaussianBlur(rng.normal(size=view.depth.shape), (0, 0), 2.5)
    deviation = constant + quadratic * np.maximum(view.depth - 0.4, 0.0) ** 2
    more = np.sqrt(factor**2 - 1.0) * deviation * noise / noise.std()
    return view.color, np.where(view.depth > 0, view.depth + more, 0.0)


def without_pixels(
    view: View, rng: np.random.Generator, *, share: float
) -> tuple[EditedColor, Array]:
    """Remove the depth of a `share` of the pixels, each by itself."""
    return view.color, np.where(rng.uniform(size=view.depth.shape) < share, 0.0, view.depth)


def without_patches(
    view: View, rng: np.random.Generator, *, share: float
) -> tuple[EditedColor, Array]:
    """Remove the depth of a `share` of the pixels, in patches."""
    field = cv2.GaussianBlur(rng.normal(size=view.depth.shape), (0, 0), PATCH)
    return view.color, np.where(field < np.quantile(field, share), 0.0, view.depth)


def quantised(view: View, rng: np.random.Generator, *, step: float) -> tuple[EditedColor, Array]:
    """Round the depth to multiples of `step`, metres."""
    return view.color, np.rint(view.depth / step) * step


def grey(view: View, rng: np.random.Generator) -> tuple[EditedColor, Array]:
    """Remove the hue of the colours."""
    lightness = cv2.cvtColor(view.color, cv2.COLOR_RGB2GRAY)
    return np.repeat(np.asarray(lightness, np.uint8)[..., None], 3, axis=2), view.depth


def exposed(view: View, rng: np.random.Generator, *, factor: float) -> tuple[EditedColor, Array]:
    """Multiply the colour values by `factor`; brighter than white is white."""
    return np.clip(view.color * factor, 0, 255).astype(np.uint8), view.depth


def other_hues(view: View, rng: np.random.Generator) -> tuple[EditedColor, Array]:
    """Turn the hues by 120 degrees."""
    hsv = np.asarray(cv2.cvtColor(view.color, cv2.COLOR_RGB2HSV), np.uint8)
    hsv[..., 0] = (hsv[..., 0].astype(int) + 60) % 180  # OpenCV's unit is two degrees
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.uint8), view.depth


def like_the_table(view: View, rng: np.random.Generator) -> tuple[EditedColor, Array]:
    """Give the objects the hue and the mean lightness of the table."""
    lab = np.asarray(cv2.cvtColor(view.color, cv2.COLOR_RGB2LAB), np.uint8)
    on_table = lab[view.object_index < 0]
    for index in range(int(view.object_index.max()) + 1):
        own = view.object_index == index
        if own.any():
            shade = lab[own][:, 0] + (np.median(on_table[:, 0]) - lab[own][:, 0].mean())
            lab[own, 0] = np.clip(shade, 0, 255).astype(np.uint8)
            lab[own, 1:] = np.median(on_table[:, 1:], axis=0).astype(np.uint8)
    return np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB), np.uint8), view.depth


def shifted(view: View, rng: np.random.Generator, *, pixels: int) -> tuple[EditedColor, Array]:
    """Shift the colour image to the right."""
    width = view.color.shape[1]
    return view.color[:, np.clip(np.arange(width) - pixels, 0, None)], view.depth


USUAL = "usual"
SIZES = ((320, 240), (480, 360), (1280, 720), (1920, 1080), (480, 640))
CURVE_POINTS: dict[str, Point] = {
    USUAL: Point(),
    **{f"distance {metres} m": Point(distance=metres) for metres in (0.35, 0.9, 1.2, 1.6)},
    **{f"elevation {deg}": Point(elevation=deg) for deg in (10, 20, 30, 70, 90)},
    **{f"size {size[0]}x{size[1]}": Point(size=size) for size in SIZES},
    **{f"roll {degrees}": Point(roll=degrees) for degrees in (30, 90, 180)},
    **{f"field of view {degrees}": Point(field_of_view=degrees) for degrees in (45, 90)},
    **{f"noise x{n}": Point(edit=partial(noisier, factor=n)) for n in (2, 4)},
    **{
        f"{percent} % missing": Point(edit=partial(without_pixels, share=percent / 100))
        for percent in (10, 30, 50)
    },
    "30 % missing in patches": Point(edit=partial(without_patches, share=0.3)),
    **{
        f"depth in steps of {mm} mm": Point(edit=partial(quantised, step=mm / 1000))
        for mm in (5, 10)
    },
    "grey": Point(edit=grey),
    "dark": Point(edit=partial(exposed, factor=0.3)),
    "overexposed": Point(edit=partial(exposed, factor=2.5)),
    "hue turned": Point(edit=other_hues),
    "objects of the table's colour": Point(edit=like_the_table),
    **{f"colour shifted {px} px": Point(edit=partial(shifted, pixels=px)) for px in (2, 5)},
}
