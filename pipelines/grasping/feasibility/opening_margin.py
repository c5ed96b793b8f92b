"""Room for an error on the side of a grasp that is not seen (D. 92).

The second contact of a symmetric grasp is a guess: a plane that lies millimetres too near puts it
inside the object, and the finger with it. A finger that is farther out closes on the object all the
same. So it opens wider, as far as nothing that is known stands in its way; less where contacts are
close, for a hand whose middle leaves the object closes beside it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.grasping.feasibility.approach_path import approach_is_free, keeps_off_table
from pipelines.grasping.feasibility.collision import clearance, meets
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import SceneCloud, Surroundings

Mask = NDArray[np.bool_]


def with_opening_margin(
    found: RankedGrasps,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
    around: Surroundings,
) -> RankedGrasps:
    """Return feasible grasps, in their order, the symmetric ones with room at the second contact.

    Each is widened by the largest of `config.opening_margins` (metres) at which it is still
    feasible; its middle moves by half of that.
    """
    grasps, waiting = found.grasps, np.flatnonzero(found.slot >= 0)
    translation, width = grasps.translation.copy(), grasps.width.copy()
    for room in config.opening_margins:
        some = grasps[waiting]
        middle = some.translation + 0.5 * room * some.closing
        wider = Grasps.unchecked(some.rotation, middle, some.width + room)
        fits = is_feasible(wider, scene, gripper, config, around)
        fits &= room <= config.opening_margin_share * some.width
        translation[waiting[fits]], width[waiting[fits]] = middle[fits], wider.width[fits]
        waiting = waiting[~fits]
    widened, free = np.flatnonzero(width > grasps.width), found.clearance.copy()
    grasps = Grasps.unchecked(grasps.rotation, translation, width)
    free[widened] = clearance(grasps[widened], gripper, around.others, config.clearance_cap)
    return replace(found, grasps=grasps, clearance=free)


def is_feasible(
    hands: Grasps,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
    around: Surroundings,
) -> Mask:
    """Return (n,) which hands open enough, keep off all that is known, and can get there."""
    fits = hands.width <= gripper.max_width
    if scene.limits is not None:
        fits &= scene.limits.allow(hands)
    if around.border is not None:
        fits &= around.border.is_kept(hands, gripper)
    if scene.plane is not None:
        fits &= keeps_off_table(hands, scene.plane, gripper, config)
    tried = np.flatnonzero(fits)
    few = config.max_points_inside
    met, _ = meets(hands[tried], gripper, around.met, config.body_margin, few)
    fits[tried[met]] = False
    tried = tried[~met]
    fits[tried] = approach_is_free(hands[tried], gripper, around.met, scene.coarse, config)
    return np.asarray(fits)
