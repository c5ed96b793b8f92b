"""Openings of feasible grasps, fitted to the seen surface and to the free space.

Symmetric grasps: the second contact is predicted. With a mirror plane that is millimetres too near,
the contact and its finger are inside the object. A finger farther out still closes on the object,
so the second contact gets a margin (D. 92). The margin is smaller for close contacts, since a
gripper with its middle off the object closes next to the object (D. 102).

Other grasps: the object may be wider between the fingers than at the contacts. The contacts are
moved apart until they enclose all seen points there, where the fingers meet the object (D. 153).
"""

from dataclasses import replace

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps


def with_fitted_openings(
    found: RankedGrasps, feasibility: Feasibility, clearance_cap: float
) -> RankedGrasps:
    """Return feasible grasps in order, with contacts farther apart where that is feasible.

    Clearances are computed again, up to `clearance_cap` metres.
    """
    config, grasps = feasibility.config, found.grasps
    if config.encloses_seen_points:
        grasps = _enclosing(grasps, np.flatnonzero(found.slot < 0), feasibility)
    waiting = np.flatnonzero(found.slot >= 0)
    for margin in config.opening_margins:
        roomy = waiting[margin <= config.opening_margin_share * grasps.width[waiting]]
        aside = np.broadcast_to([0.0, margin], (len(roomy), 2))
        grasps, moved = _apart(grasps, roomy, aside, feasibility)
        waiting = np.setdiff1d(waiting, moved)
    widened = np.flatnonzero(grasps.width > found.grasps.width)
    clearances = found.clearance.copy()
    clearances[widened] = feasibility.clearance(grasps[widened], clearance_cap)
    return replace(found, grasps=grasps, clearance=clearances)


def _enclosing(grasps: GraspPoses, chosen: Indices, feasibility: Feasibility) -> GraspPoses:
    """Return `grasps`; contacts of those `chosen` enclose all points between the fingers."""
    beyond = feasibility.reach_between(grasps[chosen]) - 0.5 * grasps.width[chosen, None]
    outside = (beyond > 0.0).any(axis=1)
    aside = np.maximum(beyond[outside], 0.0)
    return _apart(grasps, chosen[outside], aside, feasibility)[0]


def _apart(
    grasps: GraspPoses, chosen: Indices, aside: Array, feasibility: Feasibility
) -> tuple[GraspPoses, Indices]:
    """Return `grasps` with both contacts moved outwards by `aside` where that is feasible.

    `chosen`: (k,) grasps to move; `aside`: (k, 2) metres, against the closing axis and along it.
    Also returns the indices of the moved grasps.
    """
    some = grasps[chosen]
    middle = some.translation + 0.5 * (aside[:, 1:] - aside[:, :1]) * some.closing
    wider = GraspPoses.unchecked(some.rotation, middle, some.width + aside.sum(axis=1))
    fits = feasibility.allows(wider)
    moved, translation, width = chosen[fits], grasps.translation.copy(), grasps.width.copy()
    translation[moved], width[moved] = middle[fits], wider.width[fits]
    return GraspPoses.unchecked(grasps.rotation, translation, width), moved
