"""Pictures of a gripper: three boxes from front and side, to one scale, with the measures."""

import cv2
import numpy as np

from pipelines.grasping.gripper import Gripper
from pipelines.pictures.palette import Color, ColorImage

PIXELS_PER_METRE, EDGE = 2000, 40
BODY: Color = (215, 221, 230)
LINE_COLOR: Color = (90, 98, 110)
CONTACT_LINE: Color = (200, 30, 30)
TEXT = cv2.FONT_HERSHEY_SIMPLEX


def draw_gripper(gripper: Gripper) -> ColorImage:
    """Return a picture (H, W, 3) RGB of the open gripper, front and side; red: contact line."""
    boxes = gripper.boxes(gripper.max_width)
    reach = [float(np.abs(boxes[..., axis]).max()) for axis in (1, 2)]
    low, high = float(boxes[..., 0].min()), float(boxes[..., 0].max())
    lines = _measure_lines(gripper)
    height = max(round((high - low) * PIXELS_PER_METRE), 18 * len(lines)) + 2 * EDGE
    centers = [EDGE + reach[0] * PIXELS_PER_METRE]
    centers.append(centers[0] + (reach[0] + reach[1]) * PIXELS_PER_METRE + EDGE)
    words_at = round(centers[1] + reach[1] * PIXELS_PER_METRE) + EDGE
    picture = np.full((height, words_at + 300, 3), 255, np.uint8)
    for axis, center in zip((1, 2), centers, strict=True):
        for box in boxes[::-1]:
            x = np.rint(center + box[:, axis] * PIXELS_PER_METRE).astype(int).tolist()
            y = np.rint(EDGE + (box[:, 0] - low) * PIXELS_PER_METRE).astype(int).tolist()
            for color, weight in ((BODY, -1), (LINE_COLOR, 1)):
                cv2.rectangle(picture, (x[0], y[0]), (x[1], y[1]), color, weight)
    level = round(EDGE - low * PIXELS_PER_METRE)
    half = gripper.max_width / 2 * PIXELS_PER_METRE
    ends = (round(centers[0] - half), level), (round(centers[0] + half), level)
    cv2.line(picture, *ends, CONTACT_LINE, 2)
    for row, line in enumerate(lines):
        place = (words_at, EDGE + 18 * row)
        cv2.putText(picture, line, place, TEXT, 0.45, (30, 30, 30), 1, cv2.LINE_AA)
    return picture


def _measure_lines(gripper: Gripper) -> list[str]:
    measures = {name: value for name, value in vars(gripper).items() if name != "name"}
    name = gripper.name.encode("ascii", "replace").decode()
    lines = [f"{key}: {1000 * value:.1f} mm" for key, value in measures.items()]
    return [name, *lines, f"widest contacts: {1000 * gripper.max_width:.1f} mm"]
