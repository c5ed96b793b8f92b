"""Openings at which the fingers of a gripper, closing on one line, hold the object (D. 38).

Each finger starts half the opening from the middle of the line, a clearance outside of its contact
(less only at the widest opening), and closes on the first surface that it meets. So each surface
where the line exits the object is the farther contact of at most one opening.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.meshes.line_crossings import Crossings
from pipelines.metrics.force_closure import friction_of_cosine


@dataclass(frozen=True)
class Openings:
    """Openings of n candidates at which both fingers have a contact, in ascending order."""

    half: Array  # (n, j) metres from the middle to each finger; padded with inf
    friction: Array  # (n, j) smallest friction coefficient that holds; padded with inf

    def limited(self, max_friction: float) -> "Openings":
        """Return the openings that hold at `max_friction`."""
        return _ordered(np.where(self.friction <= max_friction, self.half, np.inf), self.friction)


def openings(below: Crossings, above: Crossings, clearance: float, max_half: float) -> Openings:
    """Return the openings of lines with crossings `below` and `above` their middle.

    `clearance`: metres between a contact and its finger before closing; `max_half`: metres from
    the middle to each finger of the open gripper.
    """
    farther = np.concatenate(
        [np.where(side.leave, side.distance, np.inf) for side in (below, above)], axis=1
    )
    half = np.minimum(farther + clearance, max_half)
    valid = farther <= max_half
    cosine = np.ones_like(farther)
    for side in (below, above):
        distance, of_side = _contacts(side, half)
        valid &= (of_side > 0.0) & (distance <= farther)
        cosine = np.minimum(cosine, of_side)
    friction = friction_of_cosine(np.where(valid, cosine, 0.0))
    return _ordered(np.where(valid, half, np.inf), friction)


def _contacts(side: Crossings, half: Array) -> tuple[Array, Array]:
    """Return distance and cosine (n, j) of the surface that a finger at `half` (n, j) meets.

    This is the last surface before the finger; a negative cosine means that the finger is inside
    the object, nan that there is no surface.
    """
    last = (side.distance[:, None, :] <= half[:, :, None]).sum(axis=2) - 1
    at = np.maximum(last, 0)
    return (
        np.where(last >= 0, np.take_along_axis(side.distance, at, axis=1), np.nan),
        np.where(last >= 0, np.take_along_axis(side.cosine, at, axis=1), np.nan),
    )


def _ordered(half: Array, friction: Array) -> Openings:
    order = np.argsort(half, axis=1, kind="stable")
    half = np.take_along_axis(half, order, axis=1)
    friction = np.take_along_axis(friction, order, axis=1)
    return Openings(half, np.where(np.isfinite(half), friction, np.inf))
