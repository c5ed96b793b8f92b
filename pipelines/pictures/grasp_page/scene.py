"""Content of a frame's page for the viewer: all numbers as one JSON object.

Camera frame, metres. Arrays are base64 of their little-endian bytes.
"""

from base64 import b64encode
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.configs import RegionConfig, ViewConfig
from pipelines.frames.rgbd import Frame
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from pipelines.grasping.gripper import Gripper
from pipelines.pictures.grasp_page.cloud import PixelCloud
from pipelines.pictures.palette import region_color
from pipelines.tabletop.sparse_depth import filled
from pipelines.tabletop.tabletop import find_tabletop

DETAIL = ("width", "affordance", "clearance", "enclosed_height", "rank_score")
FAR = 90  # percent of points within their radius
GRIPPER_LENGTH = 0.1  # metres from a grasp to the end of the gripper, approximate
SMALLEST = 0.15  # metres, smallest radius of the first view


def frame_scene(
    frame: Frame, result: FrameResult, gripper: Gripper, config: ViewConfig
) -> dict[str, Any]:
    """Return the content of a frame's page, with depth filled as in `infer`."""
    # Filled before thinning, because every n-th pixel may be a missing one.
    cloud = PixelCloud.of(replace(frame, depth=filled(frame.depth)), result, config.max_pixels)
    rows = np.sort(np.argsort(places_in_region(result.grasps), kind="stable")[: config.max_grasps])
    grasps = result.grasps.taken(rows)
    points = cloud.points()
    plane = find_tabletop(points, cloud.camera, RegionConfig(), np.random.default_rng(0)).plane
    up = np.array([0.0, -1.0, 0.0]) if plane is None else plane.normal
    camera = cloud.camera
    return {
        "name": result.name,
        "gripper": gripper.name,
        "clearance": gripper.clearance,
        "camera": {
            **{name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")},
            "columns": camera.width,
            "rows": camera.height,
        },
        "depth_step": cloud.step,
        "up": _numbers(up),
        "has_table": plane is not None,
        "focus": _focus(grasps, points),
        "regions": _regions(result, points, cloud.region),
        "sources": [str(source) for source in grasps.source],
        "left_out": len(result.grasps) - len(grasps),
        "arrays": _arrays(cloud, grasps, gripper) | {"row": encoded(rows, "<i4")},
    }


def places_in_region(grasps: GraspTable) -> NDArray[np.int64]:
    """Return (g,) the place of each grasp in its region, 0 for the best, then by rank score."""
    order = np.lexsort((-grasps.rank_score, ~grasps.is_best, grasps.region))
    regions = grasps.region[order]
    firsts = np.searchsorted(regions, regions)
    places = np.zeros(len(grasps), np.int64)
    places[order] = np.arange(len(grasps)) - firsts
    return places


def _arrays(cloud: PixelCloud, grasps: GraspTable, gripper: Gripper) -> dict[str, Any]:
    arrays = {
        "depth": (cloud.depth, "<u2"),
        "color": (cloud.color, "|u1"),
        "region": (cloud.region, "<u2"),
        "grasp_region": (grasps.region, "<i4"),
        "grasp_place": (places_in_region(grasps), "<i4"),
        "rank_in_frame": (grasps.rank_in_frame, "<i4"),
        "worth_trying": (grasps.worth_trying, "|u1"),
        "symmetry_slot": (grasps.symmetry_slot, "<i4"),
        "rotation": (grasps.rotation, "<f4"),
        "translation": (grasps.translation, "<f4"),
        "contacts": (grasps.contacts, "<f4"),
        "boxes": (gripper.boxes(grasps.width), "<f4"),
        **{name: (getattr(grasps, name), "<f4") for name in DETAIL},
    }
    return {name: encoded(array, dtype) for name, (array, dtype) in arrays.items()}


def encoded(array: NDArray[Any], dtype: str) -> dict[str, Any]:
    """Return an array as `{"dtype", "shape", "data"}`, the data base64 of its bytes in C order."""
    data = np.ascontiguousarray(array, dtype)
    return {
        "dtype": dtype,
        "shape": list(data.shape),
        "data": b64encode(data.tobytes()).decode("ascii"),
    }


def _regions(
    result: FrameResult, points: Array, labels: NDArray[np.uint16]
) -> list[dict[str, Any]]:
    table, measured = result.regions, np.isfinite(points[..., 2])
    return [
        {
            "color": region_color(region),
            "source": str(table.source[region]),
            "status": str(table.status[region]),
            "confidence": _number(table.confidence[region]),
            "symmetries": region_symmetries(
                table, region, points[measured & (labels == region + 1)]
            ),
        }
        for region in range(len(table))
    ]


def region_symmetries(table: RegionTable, region: int, points: Array) -> list[dict[str, Any]]:
    """Return the known symmetries of a region, to be drawn about the middle of its points (n, 3).

    Each is `{"slot", "kind", "confidence", "place", "direction", "radius"}`; the kind is plane,
    axis or sphere, the direction None for a sphere. A region without points gives an empty list.
    """
    if not len(points):
        return []
    middle, radius = _middle(points)
    drawn = []
    for slot, confidence in enumerate(table.symmetry_confidence[region].tolist()):
        point = table.symmetry_point[region, slot].astype(float)
        direction = table.symmetry_direction[region, slot].astype(float)
        has_direction = slot != SPHERE_SLOT
        needed = [*point, confidence, *(direction if has_direction else [])]
        if not np.isfinite(needed).all():
            continue
        # From the point of the plane or axis that is nearest to the region's middle.
        off = (middle - point) @ direction * direction
        kind, place, size = "plane", middle - off, radius
        if slot == ROTATION_SLOT:
            kind, place = "axis", point + off
        elif slot == SPHERE_SLOT:
            kind, place = "sphere", point
            size = float(np.median(np.linalg.norm(points - point, axis=1)))
        drawn.append({
            "slot": slot,
            "kind": kind,
            "confidence": confidence,
            "place": _numbers(place),
            "direction": _numbers(direction) if has_direction else None,
            "radius": size,
        })  # fmt: skip
    return drawn


def _focus(grasps: GraspTable, points: Array) -> dict[str, Any]:
    """Return place and radius of the first view: on the best grasps, else on all points."""
    best = grasps.translation[grasps.is_best].astype(float)
    best = best[np.isfinite(best).all(axis=1)]
    points = points[np.isfinite(points[..., 2])]
    middle, radius = np.array([0.0, 0.0, 1.0]), 0.0
    if len(best):
        middle, radius = _middle(best)
        radius += GRIPPER_LENGTH
    elif len(points):
        middle, radius = _middle(points)
    return {"place": _numbers(middle), "radius": max(radius, SMALLEST)}


def _middle(points: Array) -> tuple[Array, float]:
    """Return the median (3,) of points (n, 3), and the radius about it of FAR percent of them."""
    middle = np.median(points, axis=0)
    return middle, float(np.percentile(np.linalg.norm(points - middle, axis=1), FAR))


def _numbers(vector: Array) -> list[float]:
    return [float(value) for value in vector]


def _number(value: float) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    return float(value) if np.isfinite(value) else None
