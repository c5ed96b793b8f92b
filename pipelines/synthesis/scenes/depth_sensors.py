"""Models of depth sensors: noise, jitter at edges, holes, quantisation.

`kinect`: structured light; axial noise grows with the square of the distance, and surfaces that the
projector next to the camera does not light have no depth. `realsense`: stereo; smooth bumps,
foreground grown over its edges, random holes. `perfect`: true depth.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.errors import UnknownNameError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.rendering import Hits, Scene
from pipelines.geometry.transforms import transform_points


@dataclass(frozen=True)
class DepthSensor:
    """Parameters of a depth camera; lengths in metres, for noise at one metre."""

    baseline: float  # distance of camera and projector, or of the stereo pair
    axial: tuple[float, float]  # constant and quadratic part of the axial noise's deviation
    smoothness: float  # correlation length of the axial noise, pixels
    jitter: float  # standard deviation of the lateral noise, pixels
    subpixel: float  # resolved steps of disparity per pixel of the written image
    edge_loss: float  # share of pixels lost at depth edges
    grazing: float  # cosine between ray and normal below which light does not return
    holes: float  # average number of holes per frame
    fattening: int  # pixels by which near surfaces grow over far ones


SENSORS = {
    "kinect": DepthSensor(0.075, (0.0012, 0.0019), 0.0, 0.6, 8.0, 0.6, 0.17, 1.0, 0),
    "realsense": DepthSensor(0.050, (0.0006, 0.0016), 2.5, 0.4, 32.0, 0.3, 0.12, 3.0, 1),
}
DEPTH_EDGE = 0.02  # metres between neighbouring pixels at an edge; `_edges` scales it by the depth
NEAREST_EDGE = 0.5  # metres; nearer surfaces count as at this depth
CONSTANT_NOISE = 0.4  # metres, up to which the axial noise is constant
WOBBLE = 3.0  # pixels, of the border of a grown surface
LARGEST_HOLE = 60  # half axes of a hole are shorter than the image's width over this
NOTHING = 1e3  # metres; depth of pixels without a surface


def measured_depth(
    name: str,
    scene: Scene,
    hits: Hits,
    intrinsics: Intrinsics,
    T_world_cam: Array,
    rng: np.random.Generator,
) -> Array:
    """Return the depth (H, W) that sensor `name` measures, metres, 0 = missing."""
    if name == "perfect":
        return hits.depth
    if name not in SENSORS:
        raise UnknownNameError("sensor", name, [*SENSORS, "perfect"])
    sensor, depth = SENSORS[name], hits.depth
    unlit = _unlit(scene, hits, intrinsics, T_world_cam, sensor)
    if sensor.fattening:
        depth = _grown_foreground(depth, sensor.fattening, rng)
    edges = _edges(depth)
    depth = _jittered(depth, sensor.jitter, rng)
    lost = depth <= 0  # no surface
    depth = depth + _axial_noise(depth, sensor, rng)
    lost |= unlit | (_cosine(hits, intrinsics) < sensor.grazing) | _holes(depth.shape, sensor, rng)
    lost |= edges & (rng.uniform(size=depth.shape) < sensor.edge_loss)
    return np.where(lost | (hits.depth <= 0), 0.0, _quantised(depth, intrinsics, sensor))


def _unlit(
    scene: Scene, hits: Hits, intrinsics: Intrinsics, T_world_cam: Array, sensor: DepthSensor
) -> Mask:
    """Return the mask (H, W) of pixels hidden from the projector or the second camera."""
    points = transform_points(T_world_cam, intrinsics.rays() * hits.depth[..., None]).reshape(-1, 3)
    eye = T_world_cam[:3, 3] + sensor.baseline * T_world_cam[:3, 0]
    toward = eye - points
    # Rays start a millimetre off the surface.
    start = points + toward * (1e-3 / np.linalg.norm(toward, axis=1, keepdims=True))
    blocked = np.zeros(len(points), bool)
    seen = hits.depth.ravel() > 0
    blocked[seen] = scene.occluded(start[seen], toward[seen])
    return blocked.reshape(hits.depth.shape)


def _grown_foreground(depth: Array, pixels: int, rng: np.random.Generator) -> Array:
    """Return `depth` with near surfaces grown over far neighbours by up to `pixels`, unevenly."""
    far = np.where(depth > 0, depth, NOTHING)
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    near = np.minimum(cv2.erode(far, kernel), far)
    wobble = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), WOBBLE)
    grown = (wobble > 0) & (near < NOTHING) & (far - near > DEPTH_EDGE)
    return np.where(grown, near, depth)


def _edges(depth: Array) -> Mask:
    """Return the mask (H, W) of pixels within one pixel of a jump in depth."""
    kernel = np.ones((3, 3), np.uint8)
    span = cv2.dilate(depth, kernel) - cv2.erode(depth, kernel)
    return np.asarray(span > DEPTH_EDGE * np.maximum(depth, NEAREST_EDGE))


def _jittered(depth: Array, sigma: float, rng: np.random.Generator) -> Array:
    """Return, at each edge pixel, the depth of a random pixel near it."""
    rows, columns = np.indices(depth.shape)
    shift = np.rint(rng.normal(0.0, sigma, (2, *depth.shape))).astype(int)
    rows = np.clip(rows + shift[0], 0, depth.shape[0] - 1)
    columns = np.clip(columns + shift[1], 0, depth.shape[1] - 1)
    moved = depth[rows, columns]
    # Only pixels across an edge are changed; elsewhere the difference is the slope of the surface.
    return np.where(np.abs(moved - depth) > DEPTH_EDGE / 2, moved, depth)


def _axial_noise(depth: Array, sensor: DepthSensor, rng: np.random.Generator) -> Array:
    constant, quadratic = sensor.axial
    noise: Array = rng.normal(size=depth.shape)
    if sensor.smoothness:
        noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), sensor.smoothness), np.float64)
        noise /= noise.std()
    beyond = np.maximum(depth - CONSTANT_NOISE, 0.0)
    return np.asarray((constant + quadratic * beyond**2) * noise)


def _cosine(hits: Hits, intrinsics: Intrinsics) -> Array:
    """Return the cosine (H, W) between each pixel's ray and the surface's normal."""
    rays = intrinsics.rays()
    toward = -np.einsum("hwi,hwi->hw", hits.normal, rays) / np.linalg.norm(rays, axis=-1)
    return np.asarray(np.where(hits.depth > 0, toward, 1.0))


def _holes(shape: tuple[int, ...], sensor: DepthSensor, rng: np.random.Generator) -> Mask:
    """Return the mask (H, W) of a few random holes."""
    blots = np.zeros(shape, np.uint8)
    for _ in range(rng.poisson(sensor.holes)):
        center = (int(rng.integers(shape[1])), int(rng.integers(shape[0])))
        axes = tuple(int(x) for x in rng.integers(1, max(3, shape[1] // LARGEST_HOLE), 2))
        cv2.ellipse(blots, center, axes, float(rng.uniform(0, 180)), 0, 360, 1, -1)
    return blots > 0


def _quantised(depth: Array, intrinsics: Intrinsics, sensor: DepthSensor) -> Array:
    """Return `depth` rounded to steps of disparity.

    A step is a part of a pixel of the written image, so that the error depends on its size: half
    the width doubles the steps of depth. A real sensor matches in an image of fixed size.
    """
    scale = intrinsics.fx * sensor.baseline * sensor.subpixel
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.rint(scale / depth)
        return np.where(depth > 0, scale / np.maximum(steps, 1.0), 0.0)
