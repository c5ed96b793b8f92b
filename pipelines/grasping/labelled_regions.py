"""Region clouds with labels for training the network. Camera frame, metres."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from pipelines.array_types import Array, Mask, Singles
from pipelines.configs import PackConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.region_masks import RegionInstance
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.scene import RegionCloud, SceneCloud


@dataclass(frozen=True)
class LabelledSurface:
    """Points of an object's surface, object frame, and their affordance (n,)."""

    tree: KDTree
    affordance: Array

    @classmethod
    def of(cls, surface: Mapping[str, Singles]) -> "LabelledSurface":
        """Return the `points` (n, 3) and `affordance` (n,) of an affordance label."""
        points, affordance = (surface[name].astype(np.float64) for name in ("points", "affordance"))
        return cls(KDTree(points), affordance)

    def affordance_at(self, points: Array, radius: float) -> Array:
        """Return the affordance (m,) of the surface point nearest to each of `points` (m, 3).

        It is 0 without a surface point within `radius` metres.
        """
        _, nearest = self.tree.query(points, distance_upper_bound=radius)
        # Without a near point, the index is one past the last.
        return np.append(self.affordance, 0.0)[nearest]


@dataclass(frozen=True)
class LabelledCloud:
    """One region: points (P, 3), slots and table in the camera frame, affordance (P,)."""

    points: Array
    affordance: Array
    slots: SymmetrySlots
    table: Plane | None
    object_id: int
    name: str


def labelled_clouds(
    instances: Iterable[RegionInstance],
    scene: SceneCloud,
    poses: Mapping[int, Array],
    surface_of: Callable[[int], LabelledSurface],
    mask_of: Callable[[RegionInstance], Mask],
    config: PackConfig,
    rng: np.random.Generator,
) -> list[LabelledCloud]:
    """Return the regions with enough visible pixels, `config.num_points` points of each.

    The points are measured points inside the mask (H, W) that `mask_of` makes from the true mask;
    symmetries and affordance of an object are moved by its pose T_cam_obj (4, 4), `poses[id]`.
    """
    clouds = []
    for instance in instances:
        if (instance.mask & (scene.depth > 0)).sum() < config.min_pixels:
            continue
        points = RegionCloud.from_mask(mask_of(instance), scene).points
        if len(points) < config.min_pixels:
            continue
        few = len(points) < config.num_points  # then some points are repeated
        drawn = points[rng.choice(len(points), config.num_points, replace=few)]
        points_obj = transform_points(invert(poses[instance.object_id]), drawn)
        surface = surface_of(instance.object_id)
        affordance = surface.affordance_at(points_obj, config.label_radius)
        slots = SymmetrySlots.from_symmetries(instance.symmetries)
        owner = instance.object_id, instance.name
        clouds.append(LabelledCloud(drawn, affordance, slots, scene.plane, *owner))
    return clouds
