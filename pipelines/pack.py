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
from pipelines.errors import FormatError, MissingInputError, SymgraspError
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
    digests = _label_digests(root, scenes)
    items = [_item(scene, output_dir, config, seed, digests) for scene in scenes]
    step = partial(pack_scene, root=root, config=config, seed=seed)
    return run_batch(STAGE, items, step, options or BatchOptions())


def pack_scene(item: WorkItem, root: GraspNetRoot, config: PackConfig, seed: int) -> str:
    """Pack one scene; `item.arguments` are its files. Return the counts."""
    (scene,) = item.arguments
    # A frame that has poses but no depth is a fault, not a frame less.
    frame_ids = sorted({*scene.frame_ids, *scene.ids_of("annotations")})
    frames = [scene.frame(frame_id) for frame_id in frame_ids[:: config.frame_stride]]
    clouds: list[LabelledCloud] = []
    for frame in frames:
        rng = np.random.default_rng([seed, frame.scene_id, frame.frame_id])
        clouds += pack_frame(root, frame, config, rng)
    packed_regions.write(item.target, _stacked(clouds, config.num_points), item.stamp)
    return f"{len(clouds)} regions in {len(frames)} frames"


def pack_frame(
    root: GraspNetRoot, files: FrameFiles, config: PackConfig, rng: np.random.Generator
) -> list[LabelledCloud]:
    """Return the labelled clouds of every region of a frame that shows enough of itself."""
    depth, intrinsics = root.read_depth(files)
    label, poses = root.read_label(files), _poses(root, files)
    if label.shape != depth.shape:
        found = f"the label image is {label.shape[1]}x{label.shape[0]}"
        expected = f"the depth image is {depth.shape[1]}x{depth.shape[0]}"
        raise FormatError(files.path("label"), found, expected)
    _check_listed(files, label, poses)
    objects = {object_id: read_regioned_object(root.root, object_id) for object_id in poses}
    scene = SceneCloud(np.asarray(depth, np.float64), intrinsics)
    noise = MaskNoise(config.mask_noise_share, config.mask_edge, config.mask_blot)
    clouds = []
    for instance in visible_regions(label, intrinsics, list(poses.items()), objects):
        if (instance.mask & (depth > 0)).sum() < config.min_pixels:
            continue
        mask = noise.applied(instance.mask, rng) if config.mask_noise else instance.mask
        points = RegionCloud.from_mask(mask, scene).points
        if len(points) < config.min_pixels:
            continue
        drawn = points[_draw(len(points), config.num_points, rng)]
        pose = poses[instance.object_id]
        clouds.append(_labelled(root, instance, files.frame_id, drawn, pose, config))
    return clouds


def _poses(root: GraspNetRoot, files: FrameFiles) -> dict[int, Array]:
    """Return the pose of each object that the scene lists, by its id.

    Raises:
        FormatError: an object of the scene has no pose in this frame.
    """
    poses = {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(files)}
    missing = [i for i in root.scene(files.scene_id, files.camera).object_ids if i not in poses]
    if missing:
        raise FormatError(
            files.path("annotations"),
            f"holds no pose of object {missing[0]}",
            "object_id_list.txt names it",
        )
    return poses


def _check_listed(files: FrameFiles, label: NDArray[np.uint8], poses: dict[int, Array]) -> None:
    shown = np.flatnonzero(np.bincount(label.ravel())) - 1
    unknown = sorted(set(shown.tolist()) - poses.keys() - {-1})
    if unknown:
        raise FormatError(
            files.path("label"),
            f"shows object {unknown[0]}",
            f"{files.path('annotations').name} has no pose of it",
        )


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
    tree, surface_affordance = _affordance(*_version(root.affordance_path(instance.object_id)))
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


def _version(path: Path) -> tuple[Path, int]:
    """Return `path` and when it was written: what is kept in memory is of that time."""
    if not path.is_file():
        raise MissingInputError(path, "symgrasp refine-grasps")
    return path, path.stat().st_mtime_ns


@lru_cache(maxsize=256)
def _affordance(path: Path, written: int) -> tuple[KDTree, Array]:
    """Return a tree of the labelled surface points and their affordance, object frame."""
    surface = affordance_labels.read_surface(path)
    return KDTree(surface["points"].astype(np.float64)), surface["affordance"].astype(np.float64)


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


def _label_digests(root: GraspNetRoot, scenes: Sequence[SceneFiles]) -> dict[int, dict[str, str]]:
    """Return the digests of each object's labels: taken once, not once a scene."""
    listed = {object_id for scene in scenes for object_id in _object_ids(scene)}
    return {
        object_id: {
            # A label that is not there fails its scenes, when it is read.
            path.name: digest(path) if path.is_file() else "missing"
            for path in (root.symmetry_path(object_id), root.affordance_path(object_id))
        }
        for object_id in sorted(listed)
    }


def _object_ids(scene: SceneFiles) -> list[int]:
    """Return the scene's objects; none if the list is at fault, which then fails the scene."""
    try:
        return scene.object_ids
    except SymgraspError:
        return []


def _item(
    scene: SceneFiles,
    output_dir: Path,
    config: PackConfig,
    seed: int,
    digests: dict[int, dict[str, str]],
) -> WorkItem:
    inputs = {"frames": str(scene.num_frames)}
    for object_id in _object_ids(scene):
        inputs |= digests[object_id]
    name = f"scene_{scene.scene_id:04d}_{scene.camera}"
    stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
    return WorkItem(name, output_dir / f"{name}.h5", stamp, (scene,))
