"""Stage `pack`: labelled region point clouds of frames, for training (Sec. III-E).

Reads   ROOT/scenes/scene_NNNN/CAMERA/{depth,label,annotations}   sensor depth, masks, poses
        ROOT/models/NNN/nontextured.ply
        ROOT/symmetry/NNN.json       from annotate-symmetry
        ROOT/affordance/NNN.h5       from refine-grasps
Writes  PACKED/scene_NNNN_CAMERA.h5  one file per scene; camera frame

The points are sensor points inside a mask with a detector's errors, as at inference. Symmetries and
affordance are labels of the object, moved by its pose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from pipelines.array_types import Mask
from pipelines.configs import PackConfig, RegionConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles
from pipelines.dataset.held_back import refuse_held_back
from pipelines.dataset.scene_digests import inputs_of_scenes
from pipelines.dataset.symmetry.regioned_objects import read_regioned_object
from pipelines.dataset.training import affordance_labels, packed_regions
from pipelines.dataset.training.mask_noise import MaskNoise
from pipelines.dataset.training.packed_regions import PackedScene
from pipelines.dataset.training.region_frames import read_posed_label, strided_frames
from pipelines.errors import counted
from pipelines.geometry.region_masks import RegionInstance, visible_regions
from pipelines.geometry.symmetry import NUM_SLOTS
from pipelines.grasping.labelled_regions import LabelledCloud, LabelledSurface, labelled_clouds
from pipelines.grasping.scene import SceneCloud
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import refuse_file_as_folder
from pipelines.storage.provenance import FileVersion, make_stamp
from pipelines.tabletop.levelling import table_row
from pipelines.tabletop.tabletop import find_tabletop

STAGE = "pack"


@one_run_at_a_time(STAGE, "output_dir")
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
    """Pack every scene of `split` (None: all) as seen by `camera` (None: by each camera)."""
    options = options or BatchOptions()
    refuse_file_as_folder(output_dir)
    root = GraspNetRoot.finished(source)
    refuse_held_back(root)
    scenes = root.chosen_scenes(camera, split)
    inputs = inputs_of_scenes(root, scenes, with_affordance=True)
    items = [
        _item(scene, output_dir, config, seed, of_scene)
        for scene, of_scene in zip(scenes, inputs, strict=True)
    ]
    step = partial(pack_scene, root=root, config=config, seed=seed)
    report = run_batch(STAGE, items, step, options)
    made = {*report.done, *report.skipped}
    if others := sorted({*packed_regions.packed_files(output_dir)} - {i.target for i in items}):
        report.notes[str(output_dir)] = (
            f"{counted(len(others), 'packed scene')} of other runs, which train reads too; remove "
            f"what is of another dataset, for example {others[0]}"
        )
    elif made and not options.dry_run:
        _note_lack_of_scenes([item.target for item in items if item.name in made], report)
    return report


def _note_lack_of_scenes(packed: Sequence[Path], report: StageReport) -> None:
    """Note if `train` cannot hold out a scene to validate on."""
    counts = map(packed_regions.count_regions, packed)
    scenes = packed_regions.scenes_with_regions(packed, counts)
    if len(scenes) < 2:
        report.has_next = False
        report.notes["regions"] = (
            f"of {counted(len(scenes), 'scene')}; train needs those of 2, or other packed regions "
            "with --val"
        )


def pack_scene(item: WorkItem, root: GraspNetRoot, config: PackConfig, seed: int) -> str:
    """Pack one scene; `item.arguments`: its files. Return the counts."""
    (scene,) = item.arguments
    frames = strided_frames(scene, config.frame_stride)
    clouds: list[LabelledCloud] = []
    frame_of_cloud: list[int] = []
    for frame in frames:
        rng = np.random.default_rng([seed, frame.scene_id, frame.frame_id])
        clouds += pack_frame(root, frame, config, rng)
        frame_of_cloud += [frame.frame_id] * (len(clouds) - len(frame_of_cloud))
    packed = _stacked(clouds, frame_of_cloud, config.num_points)
    packed_regions.write(item.target, packed, item.stamp)
    return f"{counted(len(clouds), 'region')} in {counted(len(frames), 'frame')}"


def pack_frame(
    root: GraspNetRoot, files: FrameFiles, config: PackConfig, rng: np.random.Generator
) -> list[LabelledCloud]:
    """Return the labelled clouds of the sufficiently visible regions of a frame."""
    depth, intrinsics = root.read_depth(files)
    label, poses = read_posed_label(root, files, depth.shape)
    objects = {object_id: read_regioned_object(root.root, object_id) for object_id in poses}
    scene = SceneCloud(np.asarray(depth, np.float64), intrinsics)
    plane = find_tabletop(scene.xyz, intrinsics, RegionConfig(), np.random.default_rng(0)).plane
    scene = replace(scene, plane=plane)
    noise = MaskNoise(config.mask_noise_share, config.mask_edge, config.mask_blot)
    shown = visible_regions(label, intrinsics, list(poses.items()), objects)

    def mask_of(instance: RegionInstance) -> Mask:
        return noise.applied(instance.mask, rng) if config.mask_noise else instance.mask

    def surface_of(object_id: int) -> LabelledSurface:
        return _surface(FileVersion.of(affordance_labels.current_path(root, object_id)))

    return labelled_clouds(shown, scene, poses, surface_of, mask_of, config, rng)


@lru_cache(maxsize=256)
def _surface(labels: FileVersion) -> LabelledSurface:
    """Return the labelled points of the surface, object frame."""
    return LabelledSurface.of(affordance_labels.read_surface(labels.path))


def _stacked(
    clouds: Sequence[LabelledCloud], frame_of_cloud: Sequence[int], num_points: int
) -> PackedScene:
    return PackedScene(
        points=np.reshape([cloud.points for cloud in clouds], (-1, num_points, 3)),
        affordance=np.reshape([cloud.affordance for cloud in clouds], (-1, num_points)),
        existence=np.reshape([cloud.slots.probability for cloud in clouds], (-1, NUM_SLOTS)),
        point=np.reshape([cloud.slots.point for cloud in clouds], (-1, NUM_SLOTS, 3)),
        direction=np.reshape([cloud.slots.direction for cloud in clouds], (-1, NUM_SLOTS, 3)),
        table=np.reshape([table_row(cloud.table) for cloud in clouds], (-1, 4)),
        object_id=np.array([cloud.object_id for cloud in clouds], np.int32),
        frame_id=np.array(frame_of_cloud, np.int32),
        name=np.array([cloud.name for cloud in clouds], np.object_),
    )


def _item(
    scene: SceneFiles, output_dir: Path, config: PackConfig, seed: int, inputs: Mapping[str, str]
) -> WorkItem:
    stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
    return WorkItem(scene.name, output_dir / f"{scene.name}.h5", stamp, (scene,))
