"""Labels of a frame's regions on its picture: number, score of the best grasp, and status."""

from collections.abc import Sequence

import cv2
import numpy as np

from pipelines.array_types import Mask
from pipelines.grasp_files.grasps_tables import REGION_MEASURED, FrameResult
from pipelines.pictures.frame_canvas import FrameCanvas, PixelBox
from pipelines.pictures.lettering import write_with_halo
from pipelines.pictures.palette import ColorImage, region_color, rgb

SMALLEST_TEXT = 0.4  # scale of the font; smaller digits cannot be told apart


def write_numbers(canvas: FrameCanvas, result: FrameResult, masks: Sequence[Mask]) -> None:
    """Write the label of each region above its mask, or where it hides no label before it."""
    picture, (left, top, right, bottom) = canvas.picture, canvas.part
    rows, columns = picture.shape[:2]
    scale = max(SMALLEST_TEXT, columns / 1280)
    weight = rim = max(1, round(2 * scale))
    boxes: list[PixelBox] = []
    for region, mask in enumerate(masks):
        v, u = np.nonzero(mask[top:bottom, left:right])
        if not len(v):
            continue
        text = _label(result, region)
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, weight)
        middle, upper = np.array([np.median(u), v.min()]) * canvas.scale
        x = int(np.clip(middle - width / 2, 0, max(0, columns - width)))
        y = int(np.clip(upper - height // 2, height + 1, max(height + 1, rows - 2)))
        box = _free_box((x - rim, y - height - rim, x + width + rim, y + rim), boxes, picture)
        boxes.append(box)
        inks = rgb(region_color(region)), (0, 0, 0)
        write_with_halo(picture, text, (x, box[3] - rim), scale, inks, weight=weight, rim=rim)


def _label(result: FrameResult, region: int) -> str:
    """Return a region's number, its best score, and its status if not measured."""
    grasps = result.grasps
    best = grasps.rank_score[(grasps.region == region) & grasps.is_best]
    status = str(result.regions.status[region])
    text = f"{region}" + (f": {best[0]:.2f}" if len(best) else "")
    return text + ("" if status == REGION_MEASURED else f" {status.replace('_', ' ')}")


def _free_box(box: PixelBox, others: Sequence[PixelBox], picture: ColorImage) -> PixelBox:
    """Return `box` moved up or down by the fewest of its heights, to meet none of `others`.

    A picture without such a place within its edges gives `box` as it is.
    """
    x0, y0, x1, y1 = box
    height, rows = y1 - y0, picture.shape[0]
    for step in sorted(range(-(rows // height), rows // height + 1), key=abs):
        top, bottom = y0 + step * height, y1 + step * height
        is_free = all(
            x1 <= left or right <= x0 or bottom <= high or low <= top
            for left, high, right, low in others
        )
        if is_free and (step == 0 or (top >= 0 and bottom <= rows)):
            return x0, top, x1, bottom
    return box
