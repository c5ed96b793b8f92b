"""A frame of a can and a box on a table, with known regions, symmetries and grasps."""

import base64
import json
import re

import numpy as np

from pipelines.frames.rgbd import Frame
from pipelines.geometry.transforms import random_rotation
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from tests.geometry.tabletops import CAMERA, Box, Can, render


def toy_frame(name='desk/a <b>&"c"</script>') -> tuple[Frame, np.ndarray]:
    """The frame, and (H, W) the object of each pixel from 0, negative without an object."""
    depth, index = render([Can(0.035, 0.12), Box((0.05, 0.05, 0.05), (0.15, 0, 0))])
    color = np.zeros((*depth.shape, 3), np.uint8)
    color[...] = 90 + 40 * (index[..., None] + 1)
    color[..., 0] = np.arange(depth.shape[1]) % 256
    return Frame(name, color, depth.astype(np.float32), CAMERA), index


def toy_result(frame: Frame, index: np.ndarray, grasps=5, seed=0) -> FrameResult:
    """Random grasps near two regions: the can has an axis and two planes, the box a plane."""
    rng = np.random.default_rng(seed)
    points = CAMERA.backproject(frame.depth)
    masks = [index == 0, index == 1]
    middles = np.array([np.median(points[mask & (frame.depth > 0)], axis=0) for mask in masks])
    point = np.full((2, 5, 3), np.nan)
    direction = np.full((2, 5, 3), np.nan)
    confidence = np.zeros((2, 5))
    for region, slot, sure in ((0, 0, 0.9), (0, 1, 0.3), (0, 3, 0.8), (0, 4, 0.6), (1, 2, 0.7)):
        point[region, slot] = middles[region] + 0.01
        confidence[region, slot] = sure
        if slot != 4:
            direction[region, slot] = np.eye(3)[slot % 3]
    regions = RegionTable.from_masks(
        masks,
        confidence=[0.9, 0.4],
        source=["detector", "geometric"],
        symmetry_confidence=confidence,
        symmetry_point=point,
        symmetry_direction=direction,
        affordance_mean=np.zeros(2),
        affordance_max=np.zeros(2),
    )
    rotation = np.array([random_rotation(rng) for _ in range(grasps)]).reshape(-1, 3, 3)
    region = np.sort(np.arange(grasps) % 2)
    translation = middles[region] + rng.normal(0, 0.03, (grasps, 3))
    width = rng.uniform(0.02, 0.08, grasps)
    half = width[:, None] / 2 * rotation[:, :, 1]
    table = GraspTable(
        region=region,
        rotation=rotation,
        translation=translation,
        width=width,
        contacts=np.stack([translation - half, translation + half], 1),
        affordance=np.full(grasps, np.nan),
        symmetry_slot=np.where(region == 0, 3, -1),
        source=np.array(["network", "planar"], object)[region],
        clearance=rng.random(grasps) * 0.05,
        enclosed_height=rng.random(grasps) * 0.03,
        rank_score=np.linspace(0.4, 0.1, grasps),
        is_best=np.r_[True, np.diff(region) > 0][:grasps],
    )
    status = "ok" if grasps else "empty"
    message = "" if grasps else "nothing stands out"
    return FrameResult(frame.name, status, message, CAMERA, 0.1, regions, table)


def scene_of(page: str) -> dict:
    """The scene that a page draws, read as by a browser."""
    match = re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match[1])


def decoded(entry: dict) -> np.ndarray:
    """An array of a page."""
    data = base64.b64decode(entry["data"], validate=True)
    return np.frombuffer(data, entry["dtype"]).reshape(entry["shape"])
