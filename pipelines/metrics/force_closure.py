"""Force closure of two contacts with friction, the smallest friction for it, and grasp quality.

Nguyen's condition for two point contacts: the contact line lies in both friction cones. With
`a_i` the angle between the inward normal of contact i and the line to the other contact, the grasp
is in force closure for friction mu exactly if `a_i <= arctan(mu)` for both. Hence the smallest
friction is `mu* = max(tan a_1, tan a_2)`, without the sweep over frictions of Sec. IV-A.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array
from pipelines.metrics.contacts import Contacts

MAX_FRICTION = 1.0  # Sec. IV-A: friction is swept over (0, 1]
FRICTION_GRID = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of GraspNet's labels


def min_friction(contacts: Contacts) -> Array:
    """Return (n,) the smallest friction coefficient of force closure; inf if no friction holds."""
    cosine = contacts.cosines.min(axis=1, initial=1.0)
    return friction_of_cosine(np.where(contacts.found, cosine, 0.0))


def friction_of_cosine(cosine: Array) -> Array:
    """Return the tangent (...) of the angle with `cosine`; inf where the cosine is not positive.

    `cosine`: (...) between a contact's inward normal and the line to the other contact; the
    smaller cosine of a pair decides.
    """
    closes = cosine > 0.0
    cosine = np.where(closes, np.minimum(cosine, 1.0), 1.0)
    return np.where(closes, np.sqrt(1.0 - cosine**2) / cosine, np.inf)


def on_grid(friction: ArrayLike, grid: Sequence[float] = FRICTION_GRID) -> Array:
    """Return (n,) the smallest value of `grid` that is at least `friction`; inf beyond the grid."""
    steps = np.append(np.sort(np.asarray(grid, np.float64)), np.inf)
    return np.asarray(steps[np.searchsorted(steps[:-1], np.asarray(friction, np.float64))])


def quality(friction: ArrayLike, failed: ArrayLike = False) -> Array:
    """Return grasp quality `1 - mu` (n,) (Sec. IV-A); 0 if mu > 1, without contact, or if `failed`.

    `friction`: (n,) smallest friction, inf without force closure. `failed`: (n,), e.g. collision.
    """
    mu = np.asarray(friction, np.float64)
    return np.where((mu <= MAX_FRICTION) & ~np.asarray(failed, np.bool_), 1.0 - mu, 0.0)
