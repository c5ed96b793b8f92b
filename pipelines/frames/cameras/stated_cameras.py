"""The camera as the keys of camera files state it, or one mapping below them."""

from typing import Any

import numpy as np

from pipelines.frames.cameras.stated_sizes import first_stated
from pipelines.frames.depth.stated_units import DEPTH_KEYS
from pipelines.frames.encodings.camera_texts import MATRIX_SIZES
from pipelines.frames.pairing.image_names import names_view

SYNONYMS = {
    "fx": ("fx", "_fx", "fl_x", "focal_length_x"),
    "fy": ("fy", "_fy", "fl_y", "focal_length_y"),
    "cx": ("cx", "_cx", "x_offset", "ppx", "principal_point_x"),
    "cy": ("cy", "_cy", "y_offset", "ppy", "principal_point_y"),
}
SKEW_KEYS = ("skew", "_skew")
MATRIX_KEYS = ("cam_K", "K", "k", "intrinsic_matrix", "intrinsics_matrix", "camera_matrix",
               "Camera_Matrix", "cameraMatrix", "INTRINSICS", "intrinsics", "intrinsic",
               "intrinsicMatrix", "mtx")  # fmt: skip
PROJECTION_KEYS = ("P", "projection_matrix")  # ROS's; next to fx, of a renderer or a pose
# Keys of one number for both axes, or of two. Fewer pixels than the least are a lens's millimetres.
FOCAL_KEYS, CENTER_KEYS = ("focal_length", "focalLength", "f"), ("principal_point",)
SHORTEST_IN_PIXELS = 100.0
LARGEST = 1e9  # pixels, or any unit of a lens
OAK_KEY = "cameraData"  # of the list of an OAK's cameras
OAK_SOCKETS = {0: "color", 1: "left", 2: "right"}
OAK_MODELS = {"0": "perspective", "1": "fisheye"}
ORB_SLAM = ("Camera.", "Camera1.")


def with_camera(content: dict[str, Any], view: str = "") -> dict[str, Any]:
    """Return `content` with the only mapping below it that holds a camera, if it holds none itself.

    Examples are `{"cam0": {...}}` of Kalibr, and `{"intrinsics": {"fx": ...}}`. Of several such
    mappings that differ, the one named after the `view` counts (see `view_of`). The keys of
    ORB-SLAM, such as `Camera.fx`, count without their first part.
    """
    content = _in_usual_keys(content)
    if states_a_camera(content):
        return content
    below = cameras_below(content)
    # The camera of the depth may state the unit, though that of the colour counts.
    units = {
        key: content[name][key] for name in below for key in DEPTH_KEYS if key in content[name]
    }
    if len(below) > 1 and view:
        below = [key for key in below if names_view(key, view)]
    if not below or any(content[each] != content[below[0]] for each in below):
        return content
    return {**content, **units, **_in_usual_keys(content[below[0]])}


def _in_usual_keys(content: dict[str, Any]) -> dict[str, Any]:
    """Return `content`, and what it states in other keys: ORB-SLAM's, Zivid's, OAK's, capitals."""
    zivid = _mapping(content.get("CameraIntrinsics"))
    own = _mapping(zivid.get("CameraMatrix")) | _mapping(zivid.get("Distortion"))
    own |= {
        key.partition(".")[2]: each for key, each in content.items() if key.startswith(ORB_SLAM)
    }
    facts = {key: each for key, each in (content | own).items() if not isinstance(each, dict)}
    lower = {key.lower(): each for key, each in facts.items()}
    return _rendered(content) | _both_axes(content) | _of_oak(content) | lower | own | content


def _of_oak(content: dict[str, Any]) -> dict[str, Any]:
    """Return the calibrated cameras of an OAK, pairs of socket and camera, by names."""
    cameras = {}
    for pair in content[OAK_KEY] if isinstance(content.get(OAK_KEY), list) else []:
        match pair:
            case [int(socket), {"width": int(width), **camera}] if width > 0:
                model = OAK_MODELS.get(str(camera.get("cameraType")), "of another type")
                name = OAK_SOCKETS.get(socket, f"socket {socket}")
                cameras[name] = {"width": width, "distortion_model": model, **camera}
    return cameras


def _rendered(content: dict[str, Any]) -> dict[str, Any]:
    """Return the camera that Isaac Sim states by the lens and the width of what it sees."""
    keys = ("renderProductResolution", "cameraAperture", "cameraFocalLength")
    match [content.get(key) for key in keys]:
        case [[int(width), int(height)], [int() | float() as seen, _], int() | float() as length]:
            numbers = _numbers([width, height, seen, length])
            is_pinhole = content.get("cameraModel", "pinhole") == "pinhole"
            if is_pinhole and len(numbers) == 4 and seen > 0:
                lengths = dict.fromkeys(("fx", "fy"), width * length / seen)
                center = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
                return lengths | center | {"width": width, "height": height}
    return {}


def _both_axes(content: dict[str, Any]) -> dict[str, Any]:
    """Return the focal lengths and the principal point that are stated in one key each."""
    lengths, center = (_two(first_stated(content, keys)) for keys in (FOCAL_KEYS, CENTER_KEYS))
    are_pixels = len(lengths) == 2 and min(lengths) >= SHORTEST_IN_PIXELS
    return dict(zip(("fx", "fy"), lengths if are_pixels else [], strict=False)) | dict(
        zip(("cx", "cy"), center, strict=False)
    )


def _two(stated: object) -> list[float]:
    """Return the numbers of a list of two, or one number twice; an empty list for other values."""
    numbers = stated if isinstance(stated, list) else [stated, stated]
    found = _numbers(numbers)
    return found if len(found) == len(numbers) == 2 else []


def _numbers(values: list[Any]) -> list[float]:
    """Return the numbers among `values` that can be those of a camera."""
    numbers = (each for each in values if isinstance(each, int | float))
    return [float(each) for each in numbers if abs(each) <= LARGEST]


def cameras_below(content: dict[str, Any]) -> list[str]:
    """Return the keys of the mappings in `content` that hold a camera."""
    below = {key: each for key, each in content.items() if isinstance(each, dict)}
    return [key for key, each in below.items() if states_a_camera(_in_usual_keys(each))]


def states_a_camera(content: dict[str, Any]) -> bool:
    """Return whether the keys of `content` itself state a camera."""
    return stated_matrix(content) is not None or first_stated(content, SYNONYMS["fx"]) is not None


def is_bare_camera(content: Any) -> bool:  # noqa: ANN401 - JSON or YAML
    """Return whether `content` is a list of the size of a matrix, or of fx, fy, cx, cy."""
    try:
        shape = np.shape(content) if isinstance(content, list) else ()
    except ValueError:  # ragged
        return False
    return shape == (len(SYNONYMS),) or int(np.prod(shape)) in MATRIX_SIZES


def stated_matrix(content: dict[str, Any]) -> list[Any] | dict[str, Any] | None:
    """Return the list of a matrix, or the mapping with its `data`; `{"fx": ...}` is none."""
    has_lengths = first_stated(content, SYNONYMS["fx"]) is not None
    keys = MATRIX_KEYS if has_lengths else (*MATRIX_KEYS, *PROJECTION_KEYS)
    stated = (content.get(key) for key in keys)
    return next((m for m in stated if isinstance(m, list) or "data" in _mapping(m)), None)


def _mapping(value: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
    return value if isinstance(value, dict) else {}
