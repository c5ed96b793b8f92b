"""The unit of the depth as users and the files next to images state it.

The keys conflict: GraspNet's factor_depth and our depth_scale divide, BOP's depth_scale multiplies
to millimetres, RealSense's is metres per unit.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipelines.errors import ValueRangeError

DEPTH_KEYS = (
    *("depth_units_per_metre", "depth_scale", "factor_depth"),
    # Of other spellings, ORB-SLAM, NICE-SLAM, nerfstudio and instant-ngp.
    *("depth_units_per_meter", "depthScale", "depth_scale_factor", "depth_factor", "depthFactor"),
    *("DepthMapFactor", "depth_map_factor", "png_depth_scale", "depth_unit_scale_factor"),
    *("integer_depth_scale", "depth_units", "depth_unit"),
)
SCALE_KEYS = (*DEPTH_KEYS[:3], "scale", *DEPTH_KEYS[3:])
BOP_KEYS = ("depth_scale", "scale")
BOP_SCALES = 0.05, 1.0  # depth_scale of BOP's files; no camera's unit is 5 cm to 1 m
NAMES = {
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), 1000.0),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters"), 100.0),
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
}
UNITS_RANGE = (1e-3, 1e9)  # kilometres to nanometres: beyond, a file is damaged


def check_units(name: str, units: float | None) -> None:
    """Raise a ValueRangeError if `units` cannot be units per metre; None (unknown) is allowed.

    `units` may have any type, as in a POST.
    """
    low, high = UNITS_RANGE
    if units is None:
        return
    is_number = isinstance(units, int | float | np.number) and not isinstance(units, bool)
    if not is_number or not low <= units <= high:  # written so that nan fails too
        found = units if is_number else repr(units)
        raise ValueRangeError(name, found, f"a number between {low:g} and {high:g} units per metre")


def units_in(content: Mapping[str, Any]) -> float | None:
    """Return the units per metre that the keys of a camera file state, None without such a key.

    Raises:
        TypeError, ValueError: a value that is neither a number nor the name of a unit.
    """
    key = next((key for key in SCALE_KEYS if content.get(key) is not None), None)
    if key is None:
        return None
    stated = content[key]
    if isinstance(stated, str) and stated.strip().lower() in NAMES:
        return NAMES[stated.strip().lower()]
    scale = float(stated)
    low, high = BOP_SCALES
    is_bop = key in BOP_KEYS and "cam_K" in content
    is_bop |= key == "depth_scale" and low <= scale <= high
    if is_bop and scale > 0:
        return 1000.0 / scale  # BOP: times depth_scale gives millimetres
    return 1.0 / scale if 0 < scale < 1 else scale  # below one: RealSense's metres per unit
