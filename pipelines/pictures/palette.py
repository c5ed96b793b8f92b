"""The colours of frames' pictures, pages and recordings; the legend is in formats.md.

A gripper has the colour of its score, grey for 0 to green for 1. A region has the colour of its
number. Mirror planes 0, 1 and 2 are pink, blue and amber sheets; axes and spheres are red.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

ColorImage = NDArray[np.uint8]  # (H, W, 3) RGB
Color = tuple[int, int, int]  # RGB, 0 to 255
SCORE_COLORS = ("#8a929c", "#a3b07d", "#b4d25f", "#7ee95c", "#3cff5a")  # of 0, 0.25, 0.5, 0.75, 1
PLANE_COLORS = ("#ff50c8", "#5a82ff", "#ffbe28")  # mirror planes 0, 1, 2
AXIS_COLOR = "#ff3c3c"  # also of spheres
CONTACT_COLOR = "#ff2828"
REGION_COLORS = (  # by number, repeated
    "#4c9be8", "#f2a33c", "#c77dff", "#3ccfb4", "#ff7aa8", "#d8c63a",
    "#8aa0ff", "#ff8a5c", "#63c7ff", "#b58a5a", "#9ad14b", "#e08ad6",
)  # fmt: skip


def rgb(text: str) -> Color:
    """Return the colour `#rrggbb`."""
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


def region_color(region: int) -> str:
    """Return the colour of a region, `#rrggbb`."""
    return REGION_COLORS[region % len(REGION_COLORS)]


def score_colors(scores: ArrayLike) -> NDArray[np.uint8]:
    """Return (n, 3) RGB of `scores` (n,), 0 to 1."""
    stops = np.array([rgb(text) for text in SCORE_COLORS], np.float64)
    places = np.linspace(0.0, 1.0, len(stops))
    channels = [np.interp(np.nan_to_num(scores), places, stops[:, i]) for i in range(3)]
    return np.stack(channels, -1).round().astype(np.uint8)
