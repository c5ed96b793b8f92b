"""Colour images: procedural textures under lamps with cast shadows, and effects of a camera."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.rendering import Hits, Scene
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points, unit
from pipelines.synthesis.scenes.cameras import direction_at

Texture = Callable[[Array], Array]  # points (n, 3) metres, object frame -> colours (n, 3) 0..1

SHADOW_OFFSET = 5e-4  # metres off the surface, so that the surface does not shade itself


@dataclass(frozen=True)
class Lighting:
    """One distant lamp."""

    direction: Array  # (3,) unit, toward the lamp
    color: Array  # (3,) RGB
    ambient: float  # share 0 to 1 of the light that comes from all directions
    gloss: float  # strength of its reflections
    shine: float = 40.0  # exponent of the reflections; a larger one sharpens them
    shadow: float = 0.15  # share of the direct light that reaches shadows


@dataclass(frozen=True)
class CameraLook:
    """Effects of a camera on the image."""

    # factor of each channel (3,), white balance included
    exposure: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gamma: float = 1 / 1.5  # exponent of the response
    noise: float = 2.0  # standard deviation, grey levels
    vignette: float = 0.0  # share of the light that the corners lose
    blur: float = 0.0  # standard deviation, pixels
    quality: int | None = None  # JPEG quality, percent; None without compression


PLAIN_LOOK = CameraLook()


def drawn_lighting(rng: np.random.Generator) -> Lighting:
    """Return a random lamp above the table."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(35, 85))
    direction = direction_at(azimuth, elevation)
    warmth = rng.uniform(-0.08, 0.08)
    color = np.array([1.0 + warmth, 1.0, 1.0 - warmth]) * rng.uniform(0.75, 1.1)
    return Lighting(direction, color, rng.uniform(0.3, 0.55), rng.uniform(0.0, 0.4))


def drawn_lamps(rng: np.random.Generator) -> list[Lighting]:
    """Return one to four lamps of any colour, strength and height, with soft or hard shadows."""
    lamps = []
    count = int(rng.integers(1, 5))
    strength = rng.dirichlet(np.ones(count)) * rng.uniform(0.5, 1.6)
    for share in strength:
        azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(12, 88))
        direction = direction_at(azimuth, elevation)
        color = share * np.clip(1.0 + rng.normal(0.0, 0.15, 3), 0.4, 1.6)
        ambient, gloss = rng.uniform(0.1, 0.8), rng.uniform(0.0, 1.0) ** 2
        shine, shadow = np.exp(rng.uniform(np.log(5.0), np.log(300.0))), rng.uniform(0.0, 0.7)
        lamps.append(Lighting(direction, color, ambient, gloss, shine, shadow))
    return lamps


def drawn_look(rng: np.random.Generator) -> CameraLook:
    """Return a random camera: too dark or too light, tinted, noisy, blurred, compressed."""
    exposure = np.exp(rng.normal(0.0, 0.3)) * np.exp(rng.normal(0.0, 0.08, 3))
    return CameraLook(
        (float(exposure[0]), float(exposure[1]), float(exposure[2])),
        1.0 / rng.uniform(1.1, 2.4),
        rng.uniform(0.5, 8.0),
        rng.uniform(0.0, 0.5) * float(rng.uniform() < 0.4),
        rng.uniform(0.3, 1.2) * float(rng.uniform() < 0.4),
        int(rng.integers(35, 96)) if rng.uniform() < 0.5 else None,
    )


def drawn_color(rng: np.random.Generator, *, saturated: bool = True) -> Array:
    """Return a random colour (3,) 0..1."""
    grey = rng.uniform(0.15, 0.95)
    tint = rng.uniform(0, 1, 3)
    tint = (tint - tint.mean()) * (0.9 if saturated else 0.15)
    return np.asarray(np.clip(grey + tint, 0.03, 1.0))


def drawn_texture(rng: np.random.Generator) -> Texture:
    """Return a random texture for an object: plain, striped, checked, banded or mottled."""
    first, second = drawn_color(rng), drawn_color(rng)
    axis = unit(rng.normal(size=3)) if rng.uniform() < 0.5 else np.array([0.0, 0.0, 1.0])
    pitch, phase = rng.uniform(0.008, 0.04), rng.uniform(0, 1)
    waves, phases = rng.normal(0, 60.0, (6, 3)), rng.uniform(0, 2 * np.pi, 6)
    kind = rng.choice(["plain", "stripes", "checks", "band", "mottled"])

    def share(points: Array) -> Array:
        match kind:
            case "stripes":
                return np.asarray(((points @ axis) / pitch + phase) % 1.0 < 0.5, np.float64)
            case "checks":
                return np.asarray(np.floor(points / pitch + phase).sum(axis=1) % 2)
            case "band":
                away = np.abs(points @ axis - (phase - 0.5) * 0.04)
                return np.asarray(away < pitch, np.float64)
            case "mottled":
                return np.asarray(0.5 + 0.5 * np.sin(points @ waves.T + phases).mean(axis=1))
            case _:
                return np.zeros(len(points))

    return lambda points: first + share(points)[:, None] * (second - first)


def table_texture(rng: np.random.Generator) -> Texture:
    """Return a random texture for the table or the floor: wood, cloth or plain."""
    first = drawn_color(rng, saturated=False)
    contrast = rng.uniform(0.03, 0.25)
    waves, phases = rng.normal(0, 25.0, (5, 3)), rng.uniform(0, 2 * np.pi, 5)
    grain = rng.uniform(60.0, 200.0)
    kind = rng.choice(["wood", "cloth", "plain"])

    def share(points: Array) -> Array:
        wobble = np.sin(points @ waves.T + phases).mean(axis=1)
        match kind:
            case "wood":
                return np.asarray(np.sin(grain * points[:, 0] + 6.0 * wobble))
            case "cloth":
                return np.asarray(np.sin(800 * points[:, 0]) * np.sin(800 * points[:, 1]))
            case _:
                return np.asarray(wobble)

    return lambda points: np.asarray(
        np.clip(first * (1.0 + contrast * share(points)[:, None]), 0.0, 1.0)
    )


def shade(
    scene: Scene,
    hits: Hits,
    poses: Array,
    textures: Sequence[Texture],
    lamps: Sequence[Lighting],
    intrinsics: Intrinsics,
    T_world_cam: Array,
    rng: np.random.Generator,
    look: CameraLook = PLAIN_LOOK,
) -> NDArray[np.uint8]:
    """Return the colour image (H, W, 3) of `hits`.

    `poses` (k, 4, 4) object to world and one texture for each of the scene's k objects.
    """
    seen = hits.object_index.ravel() >= 0
    points = transform_points(
        T_world_cam, (intrinsics.rays() * hits.depth[..., None]).reshape(-1, 3)
    )[seen]
    normals = rotate_vectors(T_world_cam, hits.normal.reshape(-1, 3)[seen])
    owner = hits.object_index.ravel()[seen]
    albedo = np.zeros_like(points)
    for index, texture in enumerate(textures):
        mine = owner == index
        if mine.any():
            albedo[mine] = texture(transform_points(invert(poses[index]), points[mine]))
    color = np.full((seen.size, 3), 0.5)
    color[seen] = 0.0
    for lamp in lamps:
        color[seen] += albedo * _light(scene, points, normals, lamp)
        color[seen] += _highlight(points, normals, lamp, T_world_cam)[:, None]
    return photographed(color.reshape(*hits.depth.shape, 3), look, rng)


def photographed(color: Array, look: CameraLook, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the picture (H, W, 3) that a camera takes of the light `color` (H, W, 3), 0 to 1."""
    height, width = color.shape[:2]
    if look.vignette:
        across, down = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        color = color * (1.0 - 0.5 * look.vignette * (across**2 + down**2))[..., None]
    if look.blur:
        color = np.asarray(cv2.GaussianBlur(color, (0, 0), look.blur), np.float64)
    exposed = np.clip(color * look.exposure, 0.0, 1.0) ** look.gamma
    noisy = exposed * 255.0 + rng.normal(0.0, look.noise, color.shape)
    taken = np.asarray(np.clip(noisy, 0, 255), np.uint8)
    if look.quality is None:
        return taken
    packed = cv2.imencode(".jpg", taken, [cv2.IMWRITE_JPEG_QUALITY, look.quality])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def _light(scene: Scene, points: Array, normals: Array, lighting: Lighting) -> Array:
    """Return the light (n, 3): ambient, and diffuse outside of shadows."""
    toward = np.maximum(normals @ lighting.direction, 0.0)
    shaded = scene.occluded(
        points + SHADOW_OFFSET * normals, np.broadcast_to(lighting.direction, points.shape)
    )
    diffuse = (1.0 - lighting.ambient) * np.where(shaded, lighting.shadow, 1.0) * toward
    return np.asarray((lighting.ambient + diffuse)[:, None] * lighting.color)


def _highlight(points: Array, normals: Array, lighting: Lighting, T_world_cam: Array) -> Array:
    """Return the reflection (n,) of the lamp (Blinn-Phong)."""
    halfway = unit(unit(T_world_cam[:3, 3] - points) + lighting.direction)
    shine = np.maximum(np.einsum("ij,ij->i", normals, halfway), 0.0) ** lighting.shine
    return np.asarray(lighting.gloss * shine)
