"""Roundness of bodies of revolution that are slightly bent, oval, engraved or dented (D. 138).

A body counts as round about its bent middle line. Like an n-gon, a slight oval still misses at some
angles and not at others; but the normals of an n-gon lean to and fro by 2 / n, the normals of a
slight oval hardly lean.
Normalised coordinates: origin at the surface's centroid, unit diameter. An axis is a row
(ux, uy, uz, px, py, pz).
"""

from collections.abc import Sequence

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.transforms import basis_from_direction, rotation_about
from pipelines.mesh_symmetry.detection.symmetry_verification import (
    VERIFICATION_ANGLES,
    Samples,
    SurfaceFit,
    are_round,
    fit_of,
    turn_samples,
)
from pipelines.mesh_symmetry.surface.cylinder_profile import (
    HIGHEST_HARMONIC,
    MAX_HARMONIC,
    NEAR_AXIS,
    Axis,
    profile,
)
from pipelines.mesh_symmetry.surface.sampled_surface import Surface

LEAST_LATERAL = 0.25  # sine between normal and axis; normals of flats do not determine the middle
BEND_SCALES = (0.03, 0.02, 0.015)  # Tukey scales of the fit's steps, of the diameter
BEND_ANGLES = VERIFICATION_ANGLES[2::2]
MAX_BEND = 0.03  # of the diameter; a body with more bend is another shape
MAX_OVALNESS = 0.6  # of the limit for equal misses at all angles
STIFFNESS = 1.0  # samples' worth of a straight middle line
NUM_BANDS = 8  # bands of the height, tested separately
LEAST_BAND = 60  # samples
POLYGONS = np.arange(2, HIGHEST_HARMONIC + 1)
MAX_OVAL_LEAN = 0.045  # radians; of an oval whose width varies by 4.5 %
# Least share of the lean in one wave; 0.6 for an n-gon, 0.42 for a dented neck.
MIN_EXPLAINED = 0.5
MIN_COHERENT = 0.05  # of a wave at all heights, where noise averages out
RIDGE = 0.003  # of the samples; limits waves that a short arc does not determine
ROUGH = 0.001  # of the diameter; noise that rounds the edges of polygons is twice that
# Waves of ten-sided columns under such noise: 0.075 to 0.099, 7.4 to 9.6 deviations; of round
# bodies: up to 0.076, up to 5.0 deviations.
MAX_ROUGH_HARMONIC, CERTAIN = 0.06, 6.0


def is_nearly_round(surface: Surface, samples: Samples, axis: Array) -> bool:
    """Return whether a surface that fits turns about `axis` (6,) is round, possibly bent.

    Normals that lean in a pattern must be excluded first.
    """
    straight = np.zeros_like(samples.points)
    return _are_alike(bent_fits(surface, samples, axis, straight)) or _are_alike(
        bent_fits(surface, samples, axis, bend_of(surface, samples, axis))
    )


def _are_alike(fits: Sequence[SurfaceFit]) -> bool:
    worst = max(fit.ovalness for fit in fits)
    return worst <= MAX_OVALNESS or (worst <= 1.0 and are_round(fits))


def bent_fits(surface: Surface, samples: Samples, axis: Array, shift: Array) -> list[SurfaceFit]:
    """Return the fits of turns about a line that is offset by `shift` (n, 3) from `axis`."""
    fits = []
    for angle in VERIFICATION_ANGLES:
        moved = Samples(samples.points - shift, samples.normals)
        image = turn_samples(moved, axis[:3], axis[3:], angle)
        image = Samples(image.points + shift, image.normals)
        fits.append(fit_of(surface, samples, image, angle))
    return fits


def bend_of(surface: Surface, samples: Samples, axis: Array) -> Array:
    """Return the shift (n, 3) of the middle line across `axis` at the height of each sample.

    The shift is quadratic in the height and fits the turned samples to the surface.
    """
    points = samples.points
    height = (points - axis[3:]) @ axis[:3]
    share = (height - height.mean()) / max(float(np.ptp(height)), 1e-9)
    powers = share[:, None] ** np.arange(3)  # (n, 3)
    tangents = basis_from_direction(axis[:3])[:, 1:]  # (3, 2)
    terms = np.zeros((3, 2))
    for scale in BEND_SCALES:
        shift = powers @ terms @ tangents.T
        system, right = STIFFNESS * np.eye(6), np.zeros(6)
        for angle in BEND_ANGLES:
            turn = rotation_about(axis[:3], float(angle))
            image = (points - shift - axis[3:]) @ turn.T + axis[3:] + shift
            distance, index = surface.within(image, 2.0 * scale)
            normals = surface.normals[index]
            gap = np.einsum("nd,nd->n", image - surface.points[index], normals)
            gap = np.where(np.isfinite(distance), gap, 0.0)
            weight = np.square(np.clip(1.0 - np.square(gap / scale), 0.0, None))
            weight *= np.isfinite(distance)
            across = normals @ (np.eye(3) - turn) @ tangents  # (n, 2)
            rows = (powers[:, :, None] * across[:, None]).reshape(-1, 6)
            system = system + (rows * weight[:, None]).T @ rows
            right = right - (rows * weight[:, None]).T @ gap
        terms = terms + np.linalg.solve(system, right).reshape(3, 2)
    shift = powers @ terms @ tangents.T
    return shift if np.linalg.norm(shift, axis=1).max() < MAX_BEND else np.zeros_like(shift)


def leans_in_pattern(samples: Samples, axis: Array, noise: float = 0.0) -> bool:
    """Return whether normals lean to and fro around `axis` (6,), as those of an n-gon or oval.

    `noise`: noise of the surface, in diameters; smoothed normals of a noisy surface lean less.
    """
    p = profile(Axis(axis[:3], axis[3:]), samples.points, samples.normals)
    wall = (p.lateral > LEAST_LATERAL) & (p.radius > NEAR_AXIS)
    if wall.sum() < LEAST_BAND:
        return False
    height, angle, lean = p.height[wall], p.angle[wall], p.lean[wall]
    if _is_wave(angle, lean, POLYGONS[:1], MAX_OVAL_LEAN, MIN_EXPLAINED):
        return True
    if _is_wave(angle, lean, POLYGONS, MAX_HARMONIC, MIN_COHERENT):
        return True
    above_chance = CERTAIN**2 / len(lean)  # a wave explains 2 / n of random leans
    if noise > ROUGH and _is_wave(angle, lean, POLYGONS, MAX_ROUGH_HARMONIC, above_chance):
        return True
    borders = np.linspace(height.min(), height.max(), NUM_BANDS + 1)[1:-1]
    band = np.searchsorted(borders, height)
    return any(
        _is_wave(angle[band == number], lean[band == number], POLYGONS, MAX_HARMONIC, MIN_EXPLAINED)
        for number in range(NUM_BANDS)
        if np.count_nonzero(band == number) >= LEAST_BAND
    )


def _is_wave(angle: Array, lean: Array, orders: Indices, limit: float, least: float) -> bool:
    """Return whether one wave of `orders`, of more than `limit` radians, is in `lean` (n,).

    The wave must explain more than the share `least` of the variance, both alone and next to the
    single wave of an axis off the middle: if a hole interrupts the circle, the two are similar.
    """
    waves = np.exp(1j * np.outer(np.arange(int(orders[-1]) + 1), angle))
    once = np.stack([waves[0].real, waves[1].real, waves[1].imag])
    amplitudes = np.empty((2, len(orders)))
    amplitudes[0] = 2.0 * np.abs(waves[orders] @ lean) / len(angle)
    for column, order in enumerate(orders):
        terms = np.concatenate([once, [waves[order].real, waves[order].imag]])
        system = terms @ terms.T + RIDGE * len(angle) * np.eye(len(terms))
        amplitudes[1, column] = np.linalg.norm(np.linalg.solve(system, terms @ lean)[3:])
    amplitude = amplitudes.min(axis=0)
    explained = 0.5 * amplitude**2 / max(float(np.mean(lean**2)), 1e-12)
    return bool(((amplitude > limit) & (explained > least)).any())
