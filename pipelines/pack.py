"""pack: cut frames into region point clouds with labels, ready for training (Sec. III-E).

Reads   ROOT/scenes/scene_NNNN/CAMERA/{depth,label,annotations}   sensor depth, masks, poses
        ROOT/symmetry/NNN.json       from annotate-symmetry
        ROOT/affordance/NNN.h5       from refine-grasps
Writes  PACKED/scene_NNNN_CAMERA.h5  one file a scene; camera frame

The points are the sensor's, inside a mask like those a detector makes, so that training sees what
inference will. Symmetries and affordance are the object's, moved by its pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import PackConfig
from pipelines.errors import MissingInputError, SymgraspError
from pipelines.formats import affordance_labels, packed_regions
from pipelines.formats.graspnet import FrameFiles, GraspNetRoot, SceneFiles
from pipelines.formats.packed_regions import PackedScene
from pipelines.formats.provenance import digest, make_stamp
from pipelines.formats.regioned_objects import read_regioned_object
from pipelines.geometry.mask_noise import MaskNoise
from pipelines.geometry.region_masks import RegionInstance, visible_regions
from pipelines.geometry.symmetry import NUM_SLOTS, SymmetrySlots
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]

STAGE = "pack"


@dataclass(frozen=True)
class LabelledCloud:
    """One packed region: points (P, 3) and slots in the camera frame, affordance (P,)."""

    points: Array
    affordance: Array
    slots: SymmetrySlots
    object_id: int
    frame_id: int
    name: str


def run(
    source: Path,
    output_dir: Path,
    config: PackConfig,
    *,
    split: str | None = "train",
    camera: str | None = None,
    seed: int = 0,
    options: BatchOptions | None = None,
) -> StageReport:
    """Pack every scene of `split` (None: all) that `camera` saw (None: by every camera)."""
    root = GraspNetRoot(source)
    scenes = root.scenes(camera, split)
    if not scenes:
        wanted = f"{split or 'any'} scene" + (f" seen by {camera}" if camera else "")
        raise SymgraspError(f"{source} holds no {wanted}; name another --split or --camera")
    items = [_item(root, scene, output_dir, config, seed) for scene in scenes]
    step = partial(pack_scene, root=root, config=config, seed=seed)
    return run_batch(STAGE, items, step, options or BatchOptions())


def pack_scene(item: WorkItem, root: GraspNetRoot, config: PackConfig, seed: int) -> str:
    """Pack one scene; `item.arguments` are its files. Return the counts."""
    (scene,) = item.arguments
    frames = scene.frames()[:: config.frame_stride]
    clouds = []
    for frame in frames:
        rng = np.random.default_rng([seed, frame.scene_id, frame.frame_id])
        clouds += pack_frame(root, frame, config, rng)
    packed_regions.write(item.target, _stacked(clouds, config.num_points), item.stamp)
    return f"{len(clouds)} regions in {len(frames)} frames"


def pack_frame(
    root: GraspNetRoot, files: FrameFiles, config: PackConfig, rng: np.random.Generator
) -> list[LabelledCloud]:
    """Return the labelled clouds of every region of a frame that shows enough of itself."""
    frame, label = root.read_frame(files), root.read_label(files)
    poses = {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(files)}
    objects = {object_id: read_regioned_object(root.root, object_id) for object_id in poses}
    scene = SceneCloud(np.asarray(frame.depth, np.float64), frame.intrinsics)
    noise = MaskNoise(config.mask_noise_share, config.mask_edge, config.mask_blot)
    clouds = []
    for instance in visible_regions(label, frame.intrinsics, list(poses.items()), objects):
        if (instance.mask & (frame.depth > 0)).sum() < config.min_pixels:
            continue
        mask = noise.applied(instance.mask, rng) if config.mask_noise else instance.mask
        points = RegionCloud.from_mask(mask, scene).points
        if len(points) < config.min_pixels:
            continue
        drawn = points[_draw(len(points), config.num_points, rng)]
        pose = poses[instance.object_id]
        clouds.append(_labelled(root, instance, files.frame_id, drawn, pose, config))
    return clouds


def _draw(available: int, wanted: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return `wanted` indices: each at most once where there are enough."""
    return rng.choice(available, wanted, replace=available < wanted)


def _labelled(
    root: GraspNetRoot,
    instance: RegionInstance,
    frame_id: int,
    points: Array,
    T_cam_obj: Array,
    config: PackConfig,
) -> LabelledCloud:
    tree, surface_affordance = _affordance(root.affordance_path(instance.object_id))
    points_obj = transform_points(invert(T_cam_obj), points)
    gap, nearest = (
        np.asarray(part)
        for part in tree.query(points_obj, distance_upper_bound=config.label_radius)
    )
    near = np.isfinite(gap)
    affordance = np.zeros(len(points))
    affordance[near] = surface_affordance[nearest[near]]
    slots = SymmetrySlots.from_symmetries(instance.symmetries)
    return LabelledCloud(points, affordance, slots, instance.object_id, frame_id, instance.name)


@lru_cache(maxsize=256)
def _affordance(path: Path) -> tuple[KDTree, Array]:
    """Return a tree of the labelled surface points and their affordance, object frame."""
    if not path.is_file():
        raise MissingInputError(path, "symgrasp refine-grasps")
    labels = affordance_labels.read(path)
    return KDTree(np.asarray(labels.points, np.float64)), np.asarray(labels.affordance, np.float64)


def _stacked(clouds: Sequence[LabelledCloud], num_points: int) -> PackedScene:
    return PackedScene(
        points=np.reshape([cloud.points for cloud in clouds], (-1, num_points, 3)),
        affordance=np.reshape([cloud.affordance for cloud in clouds], (-1, num_points)),
        existence=np.reshape([cloud.slots.existence for cloud in clouds], (-1, NUM_SLOTS)),
        point=np.reshape([cloud.slots.point for cloud in clouds], (-1, NUM_SLOTS, 3)),
        direction=np.reshape([cloud.slots.direction for cloud in clouds], (-1, NUM_SLOTS, 3)),
        object_id=np.array([cloud.object_id for cloud in clouds], np.int32),
        frame_id=np.array([cloud.frame_id for cloud in clouds], np.int32),
        name=np.array([cloud.name for cloud in clouds], np.object_),
    )


def _item(
    root: GraspNetRoot, scene: SceneFiles, output_dir: Path, config: PackConfig, seed: int
) -> WorkItem:
    inputs = {"frames": str(scene.num_frames)}
    for object_id in scene.object_ids:
        for path in (root.symmetry_path(object_id), root.affordance_path(object_id)):
            # A label that is not there fails its scenes, when it is read.
            inputs[path.name] = digest(path) if path.is_file() else "missing"
    name = f"scene_{scene.scene_id:04d}_{scene.camera}"
    stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
    return WorkItem(name, output_dir / f"{name}.h5", stamp, (scene,))
