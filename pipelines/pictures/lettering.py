"""Text on pictures that can be read on any background."""

import cv2
import numpy as np

from pipelines.pictures.palette import Color, ColorImage

OPAQUE = 255


def write_with_halo(
    picture: ColorImage,
    text: str,
    place: tuple[int, int],
    scale: float,
    inks: tuple[Color, Color],
    *,
    weight: int,
    rim: int,
    font: int = cv2.FONT_HERSHEY_SIMPLEX,
) -> None:
    """Write `text` onto `picture` (H, W, 3), its letters in a halo.

    Args:
        picture: changed in place.
        text: characters of OpenCV's fonts.
        place: (x, y) pixels, the lower left corner of the first letter.
        scale: of the font.
        inks: colours of the letters and of the halo.
        weight: of the letters' strokes, pixels.
        rim: width of the halo around the strokes, pixels.
        font: OpenCV's.
    """
    (width, height), _ = cv2.getTextSize(text, font, scale, weight)
    margin = height + rim  # letters may reach below the line, and out of the measured width
    left, top = max(0, place[0] - margin), max(0, place[1] - height - margin)
    right, bottom = max(0, place[0] + width + margin), max(0, place[1] + margin)
    part = picture[top:bottom, left:right]
    if not part.size:  # the text is beside the picture
        return
    letters = np.zeros(part.shape[:2], np.uint8)
    at = place[0] - left, place[1] - top
    cv2.putText(letters, text, at, font, scale, OPAQUE, weight, cv2.LINE_AA)
    # Bold letters of OpenCV 5 are wider, so they would be no halo.
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1, 2 * rim + 1))
    for layer, color in zip((cv2.dilate(letters, disc), letters), inks[::-1], strict=True):
        share = layer[..., None] / OPAQUE
        part[:] = np.rint(share * color + (1.0 - share) * part).astype(np.uint8)
