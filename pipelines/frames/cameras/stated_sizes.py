"""The size of the images as camera files state it."""

import re
from typing import Any

WIDTH_KEYS = ("width", "img_width", "image_width", "_width", "w", "xres", "resolution x")
HEIGHT_KEYS = ("height", "img_height", "image_height", "_height", "h", "yres", "resolution y")


def first_stated(content: dict[str, Any], keys: tuple[str, ...]) -> Any:  # noqa: ANN401 - JSON
    """Return the value of the first of `keys` that is stated, else None."""
    return next((content[key] for key in keys if content.get(key) is not None), None)


def stated_size(content: dict[str, Any]) -> dict[str, int]:
    """Return width and height in pixels, or nothing if one of them is missing."""
    stated = content.get("resolution")
    sizes = content | stated if isinstance(stated, dict) else content
    width, height = first_stated(sizes, WIDTH_KEYS), first_stated(sizes, HEIGHT_KEYS)
    if isinstance(stated, str) and (found := re.fullmatch(r"(\d+) *[x*] *(\d+)", stated.strip())):
        width, height = found.groups()
    elif isinstance(stated, list) and len(stated) == 2:
        is_kalibr = isinstance(content.get("intrinsics"), list)
        width, height = stated if is_kalibr else reversed(stated)  # MegaPose has the height first
    if width is None or height is None:
        return {}
    return {"width": int(width), "height": int(height)}
