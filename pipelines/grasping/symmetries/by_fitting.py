"""Symmetries of a region by fitting alone, the geometric method of Sec. IV-E."""

from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    SPHERE_SLOT,
    Symmetry,
    SymmetrySlots,
)
from pipelines.geometry.symmetry_icp.bodies import BodyFit, axis_fit, smooth_part, sphere_fit
from pipelines.geometry.symmetry_icp.planes import PlaneFit, plane_fits
from pipelines.geometry.symmetry_icp.surface import FreeSpace, SeenSurface
from pipelines.grasping.scene import RegionCloud, SceneCloud

ACCEPTED = 0.5  # confidence that only fits within the published thresholds exceed


def symmetries_by_fitting(region: RegionCloud, scene: SceneCloud) -> SymmetrySlots:
    """Return the symmetries that fit the points of `region`, without any network.

    These are the three most confident planes, the best axis and the best sphere; a confidence above
    `ACCEPTED` means that the published thresholds are passed.
    """
    surface = SeenSurface(region.points, region.normals)
    space = FreeSpace.around(region.points, scene.depth, scene.intrinsics, scene.plane)
    planes = sorted(plane_fits(surface, space), key=_confidence, reverse=True)
    smooth = smooth_part(surface)
    found: list[tuple[int, Symmetry, float]] = [
        (slot, plane.symmetry, _confidence(plane))
        for slot, plane in zip(REFLECTION_SLOTS, planes, strict=False)
    ]
    bodies = {ROTATION_SLOT: axis_fit(smooth, space), SPHERE_SLOT: sphere_fit(smooth, space)}
    found += [(slot, body.symmetry, _confidence(body)) for slot, body in bodies.items()]
    return SymmetrySlots.of(found, "shape")


def _confidence(fit: PlaneFit | BodyFit) -> float:
    return ACCEPTED * (fit.is_accepted + fit.confidence)
