"""Procedural textures of many kinds: materials, patterns and prints in any colour.

The textures are for training on colour: surfaces hardly look alike, and no photo is used.
"""

from collections.abc import Callable

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.transforms import basis_from_direction
from pipelines.synthesis.scenes.lamplight import Texture

Field = Callable[[Array], Array]  # points (n, 3) metres -> (n,) 0 to 1

HASH = np.array([127.1, 311.7, 74.7])  # directions and factor of a hash from shaders
HASH_FACTOR = 43758.5453
PITCHES = (0.004, 0.12)  # metres, from the weave of cloth to floor boards


def varied_texture(rng: np.random.Generator, *, printed: bool = False) -> Texture:
    """Return a random texture of one to three layers; `printed`: possibly with a label."""
    layers = [_layer(rng)]
    masks: list[Field] = []
    while len(layers) < 3 and rng.uniform() < 0.35:
        layers.append(_layer(rng))
        masks.append(_hard(_field(rng), rng.uniform(0.3, 0.7)))
    if printed and rng.uniform() < 0.4:
        sheet, ink = _label(rng)
        layers += [_plain(rng), _layer(rng)]
        masks += [sheet, ink]

    def colors(points: Array) -> Array:
        shown = layers[0](points)
        for layer, mask in zip(layers[1:], masks, strict=True):
            share = mask(points)[:, None]
            shown = shown + share * (layer(points) - shown)
        return np.asarray(np.clip(shown, 0.0, 1.0))

    return colors


def any_color(rng: np.random.Generator) -> Array:
    """Return a random colour (3,) 0 to 1: black, white, grey, pale or fully saturated."""
    value, kind = rng.uniform(0.02, 1.0), rng.uniform()
    if kind < 0.25:
        return np.full(3, value)
    tint = rng.dirichlet(np.full(3, 0.6))
    saturation = rng.uniform(0.1, 1.0)
    color = value * (1.0 - saturation + saturation * tint / tint.max())
    return np.asarray(np.clip(color, 0.01, 1.0))


def _plain(rng: np.random.Generator) -> Texture:
    color = any_color(rng)
    return lambda points: np.broadcast_to(color, points.shape)


def _layer(rng: np.random.Generator) -> Texture:
    """Return one material: a palette along a field, in steps or smooth, with a fine grain."""
    if rng.uniform() < 0.2:
        return _plain(rng)
    field, grain = _field(rng), _noise(rng, rng.uniform(0.0005, 0.003), 1)
    count, depth = int(rng.integers(2, 6)), rng.uniform(0.0, 0.2)
    palette = np.stack([any_color(rng) for _ in range(count)])
    if rng.uniform() < 0.5:  # shades of one colour
        palette = palette[:1] * rng.uniform(0.5, 1.4, (count, 1))
    stepped = rng.uniform() < 0.5

    def colors(points: Array) -> Array:
        at = np.clip(field(points), 0.0, 1.0) * (count - 1)
        low = np.minimum(at.astype(int), count - 2)
        share = np.rint(at - low) if stepped else at - low
        color = palette[low] + share[:, None] * (palette[low + 1] - palette[low])
        return np.asarray(color * (1.0 + depth * (2.0 * grain(points)[:, None] - 1.0)))

    return colors


def _field(rng: np.random.Generator) -> Field:
    """Return a random pattern."""
    pitch = float(np.exp(rng.uniform(*np.log(PITCHES))))
    turn = basis_from_direction(rng.normal(size=3)) if rng.uniform() < 0.3 else np.eye(3)
    kinds = (_noise, _veins, _stripes, _rings, _checks, _tiles, _dots, _speckles, _gradient)
    made = kinds[int(rng.integers(len(kinds)))](rng, pitch)
    shift = rng.uniform(-1.0, 1.0, 3)
    return lambda points: made(points @ turn + shift)


def _noise(rng: np.random.Generator, pitch: float, octaves: int = 3) -> Field:
    waves = [
        rng.normal(0.0, 2.0 * np.pi / pitch * 2**octave, (6, 3)) * rng.uniform(0.2, 1.0, 3)
        for octave in range(octaves)
    ]
    phases = rng.uniform(0.0, 2.0 * np.pi, (octaves, 6))

    def field(points: Array) -> Array:
        total = np.zeros(len(points))
        for octave in range(octaves):
            total += np.sin(points @ waves[octave].T + phases[octave]).mean(axis=1) / 2**octave
        return np.asarray(0.5 + 0.5 * total)

    return field


def _veins(rng: np.random.Generator, pitch: float) -> Field:
    noise, width = _noise(rng, 3.0 * pitch), rng.uniform(0.05, 0.5)
    return lambda points: np.minimum(np.abs(2.0 * noise(points) - 1.0) / width, 1.0)


def _stripes(rng: np.random.Generator, pitch: float) -> Field:
    noise, warp, share = _noise(rng, 5.0 * pitch), rng.uniform(0.0, 2.0), rng.uniform(0.1, 0.9)
    sharp = rng.uniform() < 0.6

    def field(points: Array) -> Array:
        along = (points[:, 0] / pitch + warp * noise(points)) % 1.0
        return np.asarray(along < share, np.float64) if sharp else np.abs(2.0 * along - 1.0)

    return field


def _rings(rng: np.random.Generator, pitch: float) -> Field:
    """Wood: rings about an axis, stretched along the axis."""
    noise, stretch = _noise(rng, 8.0 * pitch), rng.uniform(0.02, 0.3)

    def field(points: Array) -> Array:
        drawn_out = points * [1.0, stretch, 1.0]
        radius = np.hypot(drawn_out[:, 0] + 0.3, drawn_out[:, 2])
        return (radius / pitch + 2.0 * noise(drawn_out)) % 1.0

    return field


def _checks(rng: np.random.Generator, pitch: float) -> Field:
    sizes = pitch * rng.uniform(0.5, 2.0, 3)
    return lambda points: np.asarray(np.floor(points / sizes).sum(axis=1) % 2)


def _tiles(rng: np.random.Generator, pitch: float) -> Field:
    """Tiles, boards or bricks in individual shades, with joints between them."""
    sizes = 3.0 * pitch * np.array([rng.uniform(1.0, 8.0), 1.0, 1.0])
    joint, offset = rng.uniform(0.01, 0.1), rng.uniform(0.0, 0.5)

    def field(points: Array) -> Array:
        scaled = points / sizes
        scaled[:, 0] += offset * np.floor(scaled[:, 1])
        within = scaled - np.floor(scaled)
        gap = ((within[:, :2] < joint) | (within[:, :2] > 1.0 - joint)).any(axis=1)
        return np.where(gap, 0.0, 0.3 + 0.7 * _hashed(np.floor(scaled)))

    return field


def _dots(rng: np.random.Generator, pitch: float) -> Field:
    radius, jitter = rng.uniform(0.15, 0.45), rng.uniform(0.0, 0.3)

    def field(points: Array) -> Array:
        scaled = points / (2.0 * pitch)
        cell = np.floor(scaled)
        away = scaled - cell - 0.5 + jitter * (_hashed(cell)[:, None] - 0.5)
        return np.asarray(np.linalg.norm(away, axis=1) < radius, np.float64)

    return field


def _speckles(rng: np.random.Generator, pitch: float) -> Field:
    """Granite, terrazzo, carpet: cells of random shade."""
    size = rng.uniform(0.1, 0.7) * pitch
    return lambda points: _hashed(np.floor(points / size))


def _gradient(rng: np.random.Generator, pitch: float) -> Field:
    reach = rng.uniform(2.0, 20.0) * pitch
    return lambda points: 0.5 + 0.5 * np.tanh(points[:, 0] / reach)


def _hard(field: Field, level: float) -> Field:
    return lambda points: np.asarray(field(points) > level, np.float64)


def _label(rng: np.random.Generator) -> tuple[Field, Field]:
    """Return the sheet of a label and its print: lines of letters, bars, a patch."""
    turn = basis_from_direction(rng.normal(size=3))
    half, line = rng.uniform(0.008, 0.04, 2), rng.uniform(0.002, 0.008)
    letter, filled = line * rng.uniform(0.3, 2.0), rng.uniform(0.3, 0.8)
    round_ = rng.uniform() < 0.4  # around an upright object instead of on one side of it

    def across(points: Array) -> Array:
        if round_:
            angle = np.arctan2(points[:, 1], points[:, 0])
            return np.column_stack([0.03 * angle, points[:, 2]])
        return points @ turn[:, :2]

    def sheet(points: Array) -> Array:
        return np.asarray((np.abs(across(points)) < half).all(axis=1), np.float64)

    def ink(points: Array) -> Array:
        place = across(points)
        cell = np.column_stack([np.floor(place / [letter, line]), np.zeros(len(place))])
        on = (_hashed(cell) < filled) & (place[:, 1] / line % 1.0 < 0.6)
        return np.asarray(on * (np.abs(place) < 0.9 * half).all(axis=1), np.float64)

    return sheet, ink


def _hashed(cells: Array) -> Array:
    """Return a random number (n,) 0 to 1 for each of `cells` (n, 3), the same for the same cell."""
    return np.asarray(np.abs(np.sin(cells @ HASH) * HASH_FACTOR) % 1.0)
