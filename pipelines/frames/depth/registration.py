"""Check that colour and depth of a frame are registered, by their edges, without any model.

Where depth jumps, an object ends, and colour usually changes too. The mean change of colour at
the jumps is compared with its mean at the jumps shifted by up to a sixteenth of the image.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.frames.depth.depth_checks import depth_oddities
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.tabletop.sparse_depth import DENSE, measured_share

Image = NDArray[np.float32]

WIDTH = 320  # columns of a reduced image; finer offsets do no harm
FARTHEST = 20  # largest offset, pixels of the reduced image
NEAR = 2  # pixels of the reduced image within which edges count as registered
CHANGE_WINDOW = 31  # pixels of a window; its mean change of colour, from texture, is subtracted
JUMP = 0.03  # 1/m between neighbouring pixels: 3 cm at 1 m
FEWEST_JUMPS = 50
AT_A_TIME = 10_000  # jumps, of 7 kB each; an ordinary frame has fewer
LEAST_HEIGHT = 3  # pixels of the reduced image: a slope across rows needs as many
FEW_MEASURED = 1 / 3
# Of the side: 58 real frames have at most 0.02, bundled frames, which are cut out, 0.102, and a
# camera of 640x480 on images of 848x480 has 0.123.
OFF_CENTER = 0.11
CLEAR = 4.0  # standard deviations of the other offsets by which the best match exceeds their mean
SHARE = 2 / 3  # of the best match: frames with a larger match near offset 0 count as registered


def color_offset(frame: Frame) -> tuple[int, int] | None:
    """Return the offset (x, y) of colour from depth in pixels; None if they seem registered.

    None also if edges are too few or too many to decide: None is no proof.
    """
    step = max(1, round(frame.depth.shape[1] / WIDTH))
    if frame.depth.shape[0] < step * LEAST_HEIGHT:
        return None
    changes, jumps = _color_changes(frame, step), _depth_jumps(frame.depth, step)
    if jumps.sum() < FEWEST_JUMPS:
        return None
    match = _match_at_offsets(changes, jumps)
    y, x = (int(i) for i in np.unravel_index(match.argmax(), match.shape))
    rows, columns = np.indices(match.shape)
    others = match[np.maximum(abs(rows - y), abs(columns - x)) > 2 * NEAR]
    best = match[y, x]
    near = match[FARTHEST - NEAR : FARTHEST + NEAR + 1, FARTHEST - NEAR : FARTHEST + NEAR + 1].max()
    is_clear = best > 0 and best >= others.mean() + CLEAR * others.std()
    if not is_clear or near > SHARE * best:
        return None
    return (x - FARTHEST) * step, (y - FARTHEST) * step


def _color_changes(frame: Frame, step: int) -> Image:
    height, width = (size // step for size in frame.depth.shape)
    grey = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    grey = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    dx, dy = (cv2.Sobel(grey, cv2.CV_32F, *axes) for axes in ((1, 0), (0, 1)))
    # Slopes of 8-bit values are whole numbers: the squares are exact, and the root equals hypot.
    changes = np.log1p(np.sqrt(dx * dx + dy * dy))
    return np.asarray(changes - cv2.blur(changes, (CHANGE_WINDOW, CHANGE_WINDOW)), np.float32)


def _depth_jumps(depth: Image, step: int) -> Image:
    height, width = (size // step for size in depth.shape)
    depth = depth[: height * step : step, : width * step : step]
    inverse = np.divide(1.0, depth, out=np.full_like(depth, np.nan), where=depth > 0)
    jumps = np.zeros_like(depth)
    jumps[:, 1:] = np.abs(np.diff(inverse, axis=1)) > JUMP
    jumps[1:] = np.maximum(jumps[1:], np.abs(np.diff(inverse, axis=0)) > JUMP)
    return jumps


def _match_at_offsets(changes: Image, jumps: Image) -> Image:
    """Return the mean of `changes` at the jumps, for all offsets (y, x) up to FARTHEST."""
    padded = np.pad(changes, FARTHEST)
    rows, columns = np.divmod(np.flatnonzero(jumps > 0), jumps.shape[1])
    size = 2 * FARTHEST + 1
    windows = np.lib.stride_tricks.sliding_window_view(padded, (size, size))
    total = np.zeros((size, size))
    for first in range(0, len(rows), AT_A_TIME):
        piece = slice(first, first + AT_A_TIME)
        total += windows[rows[piece], columns[piece]].sum(axis=0, dtype=np.float64)
    return np.asarray(total / len(rows), np.float32)


def _off_center(camera: Intrinsics) -> list[str]:
    """Return a sentence if the principal point is far from the middle of the image."""
    offsets = camera.cx / camera.width - 0.5, camera.cy / camera.height - 0.5
    if max(map(abs, offsets)) <= OFF_CENTER:
        return []
    return [
        f"the principal point ({camera.cx:g}, {camera.cy:g}) is far from the middle of the "
        f"{camera.width}x{camera.height} image: give the intrinsics of this image, "
        "unless it was cut out of a larger one"
    ]


def oddities(frame: Frame) -> tuple[str, ...]:
    """Return remarks for the user on a frame that can be read, a sentence each."""
    found = [*frame.notes, *_off_center(frame.intrinsics)]
    measured = float(np.count_nonzero(frame.depth != 0)) / frame.depth.size
    if measured < FEW_MEASURED:
        found.append("less than a third of the depth is measured")
    share = measured_share(frame.depth)
    if share < DENSE:
        holes = f"{100 * (1.0 - share):.0f} % of its surface"
        found.append(f"depth has holes next to most pixels ({holes}), which infer fills")
    if (offset := color_offset(frame)) is not None:
        found.append(
            f"colour seems shifted by {offset[0]}, {offset[1]} pixels from the depth: "
            "register them (RealSense: align depth to color)"
        )
    return (*found, *depth_oddities(frame.depth, frame.intrinsics.fx))
