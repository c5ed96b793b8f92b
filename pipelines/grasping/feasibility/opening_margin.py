"""The opening margin: extra width at the contact that no camera has seen (D. 92).

The second contact of a symmetric grasp is predicted: a mirror plane that lies millimetres too near
puts it inside the object, and the finger with it. A finger farther out closes on the object all the
same, so the gripper opens wider, as far as that is still feasible. The margin is less where the
contacts are close: a gripper whose middle leaves the object closes beside it.
"""

from dataclasses import replace

import numpy as np

from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps


def with_opening_margin(
    found: RankedGrasps, feasibility: Feasibility, clearance_cap: float
) -> RankedGrasps:
    """Return feasible grasps, in their order, the symmetric ones with an opening margin.

    Each is widened by the largest of `opening_margins` (metres) at which it is still feasible; its
    middle moves by half of that. Clearances are measured anew, up to `clearance_cap` metres.
    """
    grasps, waiting = found.grasps, np.flatnonzero(found.slot >= 0)
    translation, width = grasps.translation.copy(), grasps.width.copy()
    for margin in feasibility.config.opening_margins:
        some = grasps[waiting]
        middle = some.translation + 0.5 * margin * some.closing
        wider = GraspPoses.unchecked(some.rotation, middle, some.width + margin)
        fits = feasibility.allows(wider)
        fits &= margin <= feasibility.config.opening_margin_share * some.width
        translation[waiting[fits]], width[waiting[fits]] = middle[fits], wider.width[fits]
        waiting = waiting[~fits]
    widened, clearances = np.flatnonzero(width > grasps.width), found.clearance.copy()
    grasps = GraspPoses.unchecked(grasps.rotation, translation, width)
    clearances[widened] = feasibility.clearance(grasps[widened], clearance_cap)
    return replace(found, grasps=grasps, clearance=clearances)
