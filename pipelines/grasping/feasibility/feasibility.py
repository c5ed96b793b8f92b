"""The feasibility of grasps at one region of the observed scene (Sec. III-F).

A feasible grasp fits the gripper's opening and the limits of the robot, stays above the table and
inside an image border that cuts the region off, comes from the camera's side, holds something, and
is free of collision at its pose and along its approach path.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import FeasibilityConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.grasping.feasibility.collision import (
    bodies_meet,
    clearance,
    first_free,
    lowest_height,
    reach_between,
)
from pipelines.grasping.feasibility.image_border import ImageBorder
from pipelines.grasping.feasibility.surroundings import Surroundings
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.scene import RegionCloud, SceneCloud

ROUNDING = 1e-6  # metres


@dataclass(frozen=True)
class Feasibility:
    """The checks of grasps at one region, which must not meet the points `around`.

    `border`: the sides at which the image cuts the region off; None if there is no such side.
    """

    gripper: Gripper
    scene: SceneCloud
    around: Surroundings
    border: ImageBorder | None
    config: FeasibilityConfig

    @classmethod
    def at(
        cls,
        region: RegionCloud,
        scene: SceneCloud,
        gripper: Gripper,
        config: FeasibilityConfig,
        clearance_cap: float,
    ) -> "Feasibility":
        """Return the checks at `region`.

        Clearances are known up to `clearance_cap` metres, at the sides of a wide palm less far.
        """
        scene = scene if config.keeps_off_plane else replace(scene, plane=None)
        ahead, floor = gripper.finger_length + gripper.palm_depth, None
        reach = max(ahead + clearance_cap, gripper.reach + 2.0 * config.body_margin)
        if scene.plane is not None:
            # The gripper stays `min_table_distance` above the table. Enlarged by a margin, its
            # corners are lower by at most the margin times the root of three.
            lowest = config.min_table_distance - np.sqrt(3.0) * config.body_margin - ROUNDING
            floor = Plane(scene.plane.normal, float(scene.plane.offset - lowest))
        around = Surroundings.of(region, scene, reach, config.scene_resolution, floor)
        border = None
        if config.keeps_within_image:
            border = ImageBorder.of(region.mask, scene.depth, scene.sides, scene.intrinsics)
        return cls(gripper, scene, around, border, config)

    def with_unseen(self, points: Array) -> "Feasibility":
        """Return the checks with further obstacle `points` (m, 3), known by symmetry alone."""
        return replace(self, around=self.around.with_unseen(points))

    @property
    def widths(self) -> tuple[float, float]:
        """The least and the greatest distance of contacts, metres."""
        return self.config.min_width, float(self.gripper.max_width)

    def reachable(self, base: GraspPoses, angles: Array) -> tuple[GraspPoses, Indices]:
        """Return `base` (k,) at those of `angles` (m,) that pass the checks without points.

        Returns:
            The grasps (n,), in the order of `base`, and the index (n,) of each in `base`.
        """
        row, angle = np.nonzero(self._are_possible(base, angles))
        grasps = base.at_approach_angles(row, angles[angle])
        placed = self._well_placed(grasps)
        return grasps[placed], row[placed]

    def first_free(
        self, grasps: GraspPoses, stability: Array, min_stability: float, count: int
    ) -> tuple[Indices, Array]:
        """Return the indices (f,) of `grasps` that are free of collision and hold something.

        The most stable, by `stability` (n,), come first. At most `count` are returned, with at
        least `min_stability` times the stability of the first; also the enclosed heights (f,).
        """
        wanted = min_stability, count
        return first_free(grasps, self.gripper, self.around.all, self.config, stability, wanted)

    def has_free_path(self, grasps: GraspPoses) -> Mask:
        """Return a mask (n,) of `grasps` with a free path over the last `approach_distance`.

        A gripper that moves along its approach axis sweeps the space of a gripper with a longer
        palm. All points near the region count, and a subset of the pixels farther off (D. 77).
        """
        free = np.ones(len(grasps), np.bool_)
        if not self.config.approach_distance > 0.0:
            return free
        swept = self.gripper.swept(self.config.approach_distance)
        for obstacles in (self.around.all, self.scene.coarse_obstacles):
            left = np.flatnonzero(free)
            met, _ = bodies_meet(grasps[left], swept, obstacles, self.config)
            free[left] = ~met
        return free

    def allows(self, grasps: GraspPoses) -> Mask:
        """Return a mask (n,) of the feasible `grasps`, moved or widened from feasible grasps."""
        left = np.flatnonzero(grasps.width <= self.gripper.max_width)
        left = left[self._well_placed(grasps[left])]
        met, _ = bodies_meet(grasps[left], self.gripper, self.around.all, self.config)
        left = left[~met]
        left = left[self.has_free_path(grasps[left])]
        allowed = np.zeros(len(grasps), np.bool_)
        allowed[left] = True
        return allowed

    def clearance(self, grasps: GraspPoses, cap: float) -> Array:
        """Return the distance (n,) to the nearest point off the region, metres, b of Eq. 8."""
        return clearance(grasps, self.gripper, self.around.others, cap)

    def reach_between(self, grasps: GraspPoses) -> Array:
        """Return how far points between the open fingers are off the midpoint (n, 2), metres."""
        return reach_between(grasps, self.gripper, self.around.all, self.config)

    def _are_possible(self, base: GraspPoses, angles: Array) -> Mask:
        """Return a mask (k, m) of `base` (k,) that fit and come from the camera's side."""
        config, plane = self.config, self.scene.plane
        cosine, sine = np.cos(angles), np.sin(angles)

        def along(direction: Array) -> Array:
            """(k, m) cosines between approaches and `direction`, (k, 3) or (3,)."""
            ahead = (base.approach * direction).sum(axis=1)
            return np.outer(ahead, cosine) + np.outer((base.binormal * direction).sum(axis=1), sine)

        farthest = config.max_view_angle if plane is None else config.max_hidden_angle
        narrow, wide = self.widths
        fits = along(unit(base.translation)) > np.cos(farthest)
        fits &= ((base.width >= narrow) & (base.width <= wide))[:, None]
        if plane is not None:
            fits &= along(-plane.normal) > np.cos(config.max_approach_angle)
        return np.asarray(fits)

    def _well_placed(self, grasps: GraspPoses) -> Indices:
        """Return indices (f,) of `grasps` within limits, above the table and inside the image."""
        kept, scene = np.arange(len(grasps)), self.scene
        if scene.limits is not None:
            kept = kept[scene.limits.allow(grasps[kept])]
        if scene.plane is not None:  # along the whole approach path
            swept = self.gripper.swept(self.config.approach_distance)
            lowest = lowest_height(grasps[kept], swept, scene.plane)
            kept = kept[lowest >= self.config.min_table_distance]
        if self.border is not None:
            kept = kept[self.border.allows(grasps[kept], self.gripper)]
        return kept
