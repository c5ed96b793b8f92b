"""The camera as the keys of camera files state it, or one mapping below them."""

from typing import Any

from pipelines.frames.image_names import names_view
from pipelines.frames.stated_sizes import first_stated

SYNONYMS = {
    "fx": ("fx", "_fx", "fl_x"),
    "fy": ("fy", "_fy", "fl_y"),
    "cx": ("cx", "_cx", "x_offset", "ppx"),
    "cy": ("cy", "_cy", "y_offset", "ppy"),
}
SKEW_KEYS = ("skew", "_skew")
MATRIX_KEYS = ("cam_K", "K", "k", "intrinsic_matrix", "intrinsics_matrix", "camera_matrix",
               "Camera_Matrix", "cameraMatrix", "INTRINSICS", "intrinsics", "intrinsic",
               "mtx")  # fmt: skip
ORB_SLAM = ("Camera.", "Camera1.")


def with_camera(content: dict[str, Any], view: str = "") -> dict[str, Any]:
    """Return `content` with the only mapping below it that holds a camera, if it holds none itself.

    Examples are `{"cam0": {...}}` of Kalibr, and `{"intrinsics": {"fx": ...}}`. Of several such
    mappings, the one named after the `view` counts (see `view_of`). The keys of ORB-SLAM, such as
    `Camera.fx`, count without their first part.
    """
    own = {key.partition(".")[2]: each for key, each in content.items() if key.startswith(ORB_SLAM)}
    content = own | content
    if states_a_camera(content):
        return content
    below = cameras_below(content)
    if len(below) > 1 and view:
        below = [key for key in below if names_view(key, view)]
    return {**content, **content[below[0]]} if len(below) == 1 else content


def cameras_below(content: dict[str, Any]) -> list[str]:
    """Return the keys of the mappings in `content` that hold a camera."""
    return [k for k, each in content.items() if isinstance(each, dict) and states_a_camera(each)]


def states_a_camera(content: dict[str, Any]) -> bool:
    """Return whether the keys of `content` itself state a camera."""
    return stated_matrix(content) is not None or first_stated(content, SYNONYMS["fx"]) is not None


def stated_matrix(content: dict[str, Any]) -> list[Any] | dict[str, Any] | None:
    """Return the list of a matrix, or the mapping with its `data`; `{"fx": ...}` is none."""
    stated = (content.get(key) for key in MATRIX_KEYS)
    return next((m for m in stated if isinstance(m, list) or "data" in _mapping(m)), None)


def _mapping(value: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
    return value if isinstance(value, dict) else {}
