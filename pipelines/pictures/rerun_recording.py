"""A frame with its symmetries and grasps as a rerun recording, `.rrd`; needs the extra `viz`.

Entities, camera frame: `world/points`, `world/camera` with the picture,
`world/symmetries/region_N`, and `world/grasps/place_N`: the best grasp of every region, the second
of every region, and so on.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pipelines.array_types import Array
from pipelines.errors import SymgraspError
from pipelines.frames.rgbd import Frame
from pipelines.geometry.transforms import basis_from_direction, matrix_to_quaternion
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasping.gripper import Gripper
from pipelines.pictures.grasp_page.scene import places_in_region, region_symmetries
from pipelines.pictures.palette import region_color, rgb, score_colors
from pipelines.storage.files import write_bytes
from pipelines.storage.provenance import Stamp, stamp_ahead

MIN_CONFIDENCE = 0.5  # of symmetries that are recorded
WEAK_OPACITY = 90  # of 255, of grasps that are not worth trying


def need_rerun() -> Any:  # noqa: ANN401 - a module that may not be there
    """Return the module `rerun`.

    Raises:
        SymgraspError: rerun is not installed.
    """
    try:
        import rerun  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise SymgraspError('--rerun needs rerun: pip install "symgrasp[viz]"') from error
    return rerun


def write_recording(
    path: Path, frame: Frame, result: FrameResult, gripper: Gripper, stamp: Stamp
) -> None:
    """Write the recording of a frame, and its stamp next to it.

    The same frame gives the same content, not the same bytes: rerun assigns new ids each time.

    Raises:
        WriteError: there is no space.
    """
    rr = need_rerun()
    # The viewer merges recordings with the same id, also those of other grasps of the frame.
    recording_id = f"{result.name} {stamp.as_digest()}"
    stream = rr.RecordingStream("symgrasp", recording_id=recording_id)
    # Not `stream.save`: rerun writes files in a thread of its own, which hides a full disk.
    recording = stream.memory_recording()
    stream.log("world", rr.ViewCoordinates.RDF, static=True)
    _log_frame(rr, stream, frame)
    _log_symmetries(rr, stream, frame, result)
    _log_grasps(rr, stream, result, gripper)
    content = recording.drain_as_bytes()
    stream.disconnect()
    stamp_ahead(path, stamp)
    write_bytes(path, content)


def _log_frame(rr: Any, stream: Any, frame: Frame) -> None:  # noqa: ANN401 - rerun's
    points, camera = frame.intrinsics.backproject(frame.depth), frame.intrinsics
    seen = frame.depth > 0
    stream.log("world/points", rr.Points3D(points[seen], colors=frame.color[seen]), static=True)
    pinhole = rr.Pinhole(
        resolution=[camera.width, camera.height],
        focal_length=[camera.fx, camera.fy],
        principal_point=[camera.cx, camera.cy],
        image_plane_distance=0.15,
    )
    stream.log("world/camera", pinhole, static=True)
    stream.log("world/camera/color", rr.Image(frame.color).compress(), static=True)


def _log_symmetries(rr: Any, stream: Any, frame: Frame, result: FrameResult) -> None:  # noqa: ANN401
    points = frame.intrinsics.backproject(frame.depth)
    for region in range(len(result.regions)):
        mask = result.regions.mask(region, *result.size) & (frame.depth > 0)
        color = rgb(region_color(region))
        for each in region_symmetries(result.regions, region, points[mask]):
            if each["confidence"] > MIN_CONFIDENCE:
                path = f"world/symmetries/region_{region}/{each['kind']}_{each['slot']}"
                words = f"{each['kind']} {each['confidence']:.2f}"
                shape = _outline(each)
                drawn = rr.LineStrips3D([shape], colors=[color], labels=[words], radii=[0.001])
                stream.log(path, drawn, static=True)


def _outline(symmetry: dict[str, Any]) -> Array:
    """Return a line (n, 3): along an axis, around a sheet, or three circles about a centre."""
    place, radius = np.array(symmetry["place"]), symmetry["radius"]
    if symmetry["kind"] == "sphere":
        angle = np.linspace(0, 2 * np.pi, 33)
        circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(33)], 1)
        rings = np.concatenate([circle, circle[:, [0, 2, 1]], circle[:, [2, 0, 1]]])
        return np.asarray(place + radius * rings)
    direction = np.array(symmetry["direction"])
    if symmetry["kind"] == "axis":
        return np.asarray(place + np.outer([-1.4, 1.4], radius * direction))
    corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1], [-1, -1]])
    return np.asarray(place + radius * corners @ basis_from_direction(direction)[:, 1:].T)


def _log_grasps(rr: Any, stream: Any, result: FrameResult, gripper: Gripper) -> None:  # noqa: ANN401
    table, places = result.grasps, places_in_region(result.grasps)
    boxes = gripper.boxes(table.width)  # (g, 3, 2, 3)
    rotation = table.rotation.astype(np.float64)
    middles = np.einsum("gij,gbj->gbi", rotation, boxes.mean(axis=2)) + table.translation[:, None]
    halves = (boxes[:, :, 1] - boxes[:, :, 0]) / 2.0
    wxyz = matrix_to_quaternion(rotation).reshape(-1, 4)
    opacity = np.where(table.worth_trying, 255, WEAK_OPACITY).astype(np.uint8)
    colors = np.concatenate([score_colors(table.rank_score), opacity[:, None]], axis=1)
    for place in range(int(places.max(initial=-1)) + 1):
        chosen = places == place
        words = [
            f"region {region}, {source}, score {score:.3f}"
            for region, source, score in zip(
                table.region[chosen], table.source[chosen], table.rank_score[chosen], strict=True
            )
        ]
        drawn = rr.Boxes3D(
            centers=middles[chosen].reshape(-1, 3),
            half_sizes=halves[chosen].reshape(-1, 3),
            quaternions=wxyz[chosen][:, [1, 2, 3, 0]].repeat(3, axis=0),
            colors=colors[chosen].repeat(3, axis=0),
            labels=[words[i] if part == 2 else "" for i in range(len(words)) for part in range(3)],
        )
        path = f"world/grasps/place_{place:02d}"
        stream.log(path, drawn, static=True)
        contacts = rr.Points3D(table.contacts[chosen].reshape(-1, 3), radii=0.003)
        stream.log(f"{path}/contacts", contacts, static=True)
