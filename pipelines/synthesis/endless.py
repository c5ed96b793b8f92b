"""Endless training regions: new scenes, views, sensor noise and mask errors of labelled objects.

The labels of objects are made once, by `annotate-symmetry` and `refine-grasps`; a scene takes a
fraction of a second, so no scene is used twice. Objects of pools for evaluation are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.configs import EndlessConfig
from pipelines.dataset import convex_pieces as convex_file
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.symmetry.regioned_objects import read_regioned_object
from pipelines.dataset.training import affordance_labels
from pipelines.dataset.training.mask_noise import MaskFaults, MaskNoise
from pipelines.dataset.training.packed_regions import PackedRegion
from pipelines.errors import SymgraspError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.region_masks import RegionedObject, RegionInstance, visible_regions
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import invert, make_pose, random_rotation, transform_points
from pipelines.grasping.labelled_regions import LabelledCloud, LabelledSurface, labelled_clouds
from pipelines.grasping.scene import SceneCloud
from pipelines.synthesis.objects.decomposition import hull_of_points
from pipelines.synthesis.objects.pools import UNSEEN_POOLS
from pipelines.synthesis.scenes.cameras import LENSES, drawn_viewpoints, sensor_intrinsics
from pipelines.synthesis.scenes.depth_sensors import measured_depth
from pipelines.synthesis.scenes.tables import SceneLayout, SceneObject, background, drawn_layout
from pipelines.tabletop.levelling import table_row

ENDLESS = 1_000_033  # separates these draws from draws of datasets and trainings with the same seed
ATTEMPTS = 8
MARGIN = 24  # pixels rendered around the objects, into which masks may leak
OCCLUDER_REACH = (0.35, 0.75)  # of the distance from the camera to an object


@dataclass(frozen=True)
class LabelledObject:
    """An object with its mesh, regions, affordance and convex pieces."""

    scene: SceneObject
    regioned: RegionedObject
    surface: LabelledSurface

    def numbered(self, number: int) -> "LabelledObject":
        """Return the object with another `number` in scenes."""
        scene = replace(self.scene, object_id=number, name=f"{number:03d}")
        return replace(self, scene=scene)


def scene_generator(seed: int, scene: int) -> np.random.Generator:
    """Return the generator of scene number `scene` of a training with `seed`."""
    # Datasets seed with lists; a spawn key gives other numbers than any list.
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(ENDLESS, scene)))


def trainable_objects(root: GraspNetRoot) -> list[int]:
    """Return the ids of the objects that are not reserved for evaluation.

    The ids are from `objects.json` or, without this file, from the scenes of the train split.

    Raises:
        SymgraspError: there are no such objects.
    """
    listed = root.root / "objects.json"
    if listed.is_file():
        chosen = {o.object_id for o in object_list.read(listed) if o.pool not in UNSEEN_POOLS}
    else:
        scenes = root.scenes(split="train")
        root.warn_of_lost_cameras("train")
        chosen = {object_id for scene in scenes for object_id in scene.object_ids}
    if not chosen:
        raise SymgraspError(
            f"{root.root} has no objects to train on; objects.json or scenes 0 to 99 name them"
        )
    return sorted(chosen)


def read_object(root: GraspNetRoot, object_id: int) -> LabelledObject:
    """Read an object with its regions, affordance and convex pieces.

    Raises:
        MissingInputError: a label has not been made yet.
        FormatError: a label is damaged, or of another mesh.
    """
    labels = affordance_labels.current_path(root, object_id)
    regioned = read_regioned_object(root.root, object_id)
    pieces_path = root.model_path(object_id).with_name("convex.npz")
    pieces: Sequence[Mesh] = (
        convex_file.read(pieces_path)
        if pieces_path.is_file()
        else [hull_of_points(regioned.mesh.vertices)]
    )
    surface = LabelledSurface.of(affordance_labels.read_surface(labels))
    scene = SceneObject(object_id, f"{object_id:03d}", regioned.mesh, pieces)
    return LabelledObject(scene, regioned, surface)


class EndlessScenes:
    """Draw scenes of the labelled objects of a dataset, and cut them into regions."""

    def __init__(
        self, objects: Mapping[int, LabelledObject], config: EndlessConfig, seed: int
    ) -> None:
        self.objects = objects
        self.regioned = {i: each.regioned for i, each in self.objects.items()}
        self.config, self.seed = config, seed

    @classmethod
    def of_roots(cls, roots: Sequence[Path], config: EndlessConfig, seed: int) -> "EndlessScenes":
        """Return scenes of the objects of datasets that are not reserved for evaluation.

        Objects of the first of `roots` keep their numbers; those of the others follow.
        """
        objects: dict[int, LabelledObject] = {}
        for root in roots:
            files, first = GraspNetRoot(root), max(objects, default=-1) + 1
            for object_id in trainable_objects(files):
                number = first + object_id
                objects[number] = read_object(files, object_id).numbered(number)
        return cls(objects, config, seed)

    def regions(self, scene: int) -> list[PackedRegion]:
        """Return `regions_per_scene` regions of scene number `scene`, the same in every call.

        Raises:
            SymgraspError: none of `ATTEMPTS` drawn scenes shows a region.
        """
        rng, clouds, wanted = scene_generator(self.seed, scene), [], self.config.regions_per_scene
        for _ in range(ATTEMPTS):
            clouds += self._drawn_clouds(rng)
            if len(clouds) >= max(1, wanted // 2):
                break
        if not clouds:
            raise SymgraspError(
                f"no region of {ATTEMPTS} scenes is visible; are the objects too small?"
            )
        chosen = np.resize(rng.permutation(len(clouds)), wanted)  # all before one is repeated
        return [_packed(clouds[i]) for i in chosen.tolist()]

    def _drawn_clouds(self, rng: np.random.Generator) -> list[LabelledCloud]:
        config = self.config
        count = min(
            int(rng.integers(config.min_objects, config.max_objects + 1)), len(self.objects)
        )
        drawn = rng.choice(list(self.objects), count, replace=False).tolist()
        try:
            objects = [self.objects[i].scene for i in drawn]
            layout = drawn_layout(objects, config.surroundings, rng)
        except SymgraspError:  # these objects do not come to rest together; draw other objects
            return []
        sensor = str(rng.choice(list(LENSES)))
        intrinsics = sensor_intrinsics(sensor, config.width, config.height)
        others, places = background(layout, rng)
        meshes = [*(item.mesh for item in layout.objects), *others]
        poses = [*layout.poses, *places]
        scene, around = Scene(meshes, poses), layout.surroundings
        clouds: list[LabelledCloud] = []
        for T_world_cam in drawn_viewpoints(
            layout.center, config.views, intrinsics, rng, around.arc, around.elevations
        ):
            perfect = rng.uniform() < config.perfect_share
            seen_by = "perfect" if perfect else sensor
            shown = scene
            if rng.uniform() < config.occluders:
                mesh, pose = self._occluder(layout, T_world_cam, rng)
                shown = Scene([*meshes, mesh], [*poses, pose])
            clouds += self._view(layout, shown, intrinsics, seen_by, T_world_cam, rng)
        return clouds

    def _view(
        self,
        layout: SceneLayout,
        scene: Scene,
        intrinsics: Intrinsics,
        sensor: str,
        T_world_cam: Array,
        rng: np.random.Generator,
    ) -> list[LabelledCloud]:
        """Return the labelled regions that one camera sees."""
        T_cam_obj = invert(T_world_cam) @ layout.poses
        intrinsics = window_of(intrinsics, [item.mesh for item in layout.objects], T_cam_obj)
        hits = cast_view(scene, intrinsics, T_world_cam)
        depth = measured_depth(sensor, scene, hits, intrinsics, T_world_cam, rng)
        ids = np.array([item.object_id + 1 for item in layout.objects])
        mine = (hits.object_index >= 0) & (hits.object_index < len(ids))
        label = np.where(mine, ids[np.where(mine, hits.object_index, 0)], 0)
        poses = {i - 1: pose for i, pose in zip(ids.tolist(), T_cam_obj, strict=True)}
        shown = visible_regions(label, intrinsics, list(poses.items()), self.regioned)
        pack, config = self.config.pack, self.config
        noise = MaskNoise(pack.mask_noise_share, pack.mask_edge, pack.mask_blot)
        faults = MaskFaults(config.mask_leaks, config.mask_cuts)

        def mask_of(instance: RegionInstance) -> Mask:
            if not pack.mask_noise:
                return instance.mask
            return noise.applied(faults.applied(instance.mask, mine, rng), rng)

        normal = T_world_cam[2, :3]  # the world's z axis; the table is the plane z = 0
        cloud = SceneCloud(depth, intrinsics, Plane(normal, float(T_world_cam[2, 3])))
        return labelled_clouds(
            shown, cloud, poses, lambda i: self.objects[i].surface, mask_of, pack, rng
        )

    def _occluder(
        self, layout: SceneLayout, T_world_cam: Array, rng: np.random.Generator
    ) -> tuple[Mesh, Array]:
        """Return an object and its pose between the camera and one of the other objects."""
        eye, hidden = T_world_cam[:3, 3], layout.middles[rng.integers(len(layout.poses))]
        place = eye + rng.uniform(*OCCLUDER_REACH) * (hidden - eye) + rng.normal(0.0, 0.02, 3)
        drawn = self.objects[int(rng.choice(list(self.objects)))].scene
        turn = random_rotation(rng)
        return drawn.mesh, make_pose(turn, place - turn @ drawn.center)


def window_of(intrinsics: Intrinsics, meshes: Sequence[Mesh], T_cam_obj: Array) -> Intrinsics:
    """Return the camera of the image section around the posed meshes, with a margin."""
    corners = [
        transform_points(pose, mesh.vertices) for mesh, pose in zip(meshes, T_cam_obj, strict=True)
    ]
    points = np.concatenate(corners)
    pixels = intrinsics.project(points[points[:, 2] > 0.05])
    size = np.array([intrinsics.width, intrinsics.height])
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - MARGIN, 0, size - 1)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + MARGIN, low + 1, size)
    width, height = (high - low).tolist()
    return replace(
        intrinsics, cx=intrinsics.cx - low[0], cy=intrinsics.cy - low[1], width=width, height=height
    )


def _packed(cloud: LabelledCloud) -> PackedRegion:
    return PackedRegion(
        points=cloud.points.astype(np.float32),
        affordance=cloud.affordance.astype(np.float32),
        existence=cloud.slots.probability.astype(np.float32),
        point=cloud.slots.point.astype(np.float32),
        direction=cloud.slots.direction.astype(np.float32),
        table=table_row(cloud.table).astype(np.float32),
        object_id=cloud.object_id,
        frame_id=-1,
        name=cloud.name,
    )
