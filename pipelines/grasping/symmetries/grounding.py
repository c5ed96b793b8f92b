"""Predicted symmetries fitted to the seen surface, with the confidence in each (D. 31).

The network predicts a region's symmetries roughly. The measured points determine them exactly, and
whether they exist: a true symmetry maps the seen surface onto or behind seen surface, never into
observed free space.
"""

from dataclasses import dataclass

from pipelines.configs.planning import SymmetrySource
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    SPHERE_SLOT,
    Symmetry,
    SymmetrySlots,
)
from pipelines.grasping.critics.point_critic import PointCritic
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.axis_evidence import likely_axis_and_sphere
from pipelines.grasping.symmetries.plane_evidence import likely_planes
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.grasping.symmetries.sources import SOURCE_BITS, SOURCE_NAMES


@dataclass(frozen=True)
class SymmetryCritics:
    """The critics of fitted symmetries: of axes and spheres, and of mirror planes."""

    axes: PointCritic
    planes: PointCritic


def ground_symmetries(
    slots: SymmetrySlots,
    region: RegionCloud,
    scene: SceneCloud,
    critics: SymmetryCritics,
    candidates: SymmetrySource = "network+shape",
) -> SymmetrySlots:
    """Return the predicted `slots` fitted to `region`, with the confidence in each.

    Planes are ordered by confidence and may move to other slots.
    """
    evidence = RegionEvidence.of(slots, region, scene, SOURCE_BITS[candidates])
    axis, sphere = likely_axis_and_sphere(evidence, critics.axes)
    planes = likely_planes(evidence, axis[0], critics.planes)
    fitted: list[tuple[int, Symmetry, float, int]] = [
        (slot, *plane) for slot, plane in zip(REFLECTION_SLOTS, planes, strict=False)
    ]
    fitted += [(ROTATION_SLOT, *axis), (SPHERE_SLOT, *sphere)]
    found = SymmetrySlots.of(each[:3] for each in fitted)
    for slot, _, _, source in fitted:
        found.source[slot] = SOURCE_NAMES[source]
    return found
