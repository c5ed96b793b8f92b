"""Stage `export-coco`: masks of symmetric regions as a COCO instance dataset (Sec. III-D).

Reads   ROOT/scenes/scene_NNNN/CAMERA/{rgb,depth,label,annotations,camK.npy}
        ROOT/models/NNN/nontextured.ply
        ROOT/symmetry/NNN.json   regions, from annotate-symmetry
Writes  DIR/annotations/instances_{train,val}.json, DIR/images/, DIR/scenes/

The annotations of all scenes are joined once every scene is finished.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from pipelines.configs import ExportCocoConfig, check_settings
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles
from pipelines.dataset.scene_digests import inputs_of_scenes
from pipelines.dataset.training import coco_instances
from pipelines.dataset.training.region_frames import (
    held_out_scenes,
    read_region_frame,
    strided_frames,
)
from pipelines.errors import SymgraspError, counted
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import (
    atomic_path,
    existing,
    make_folder,
    real_path,
    refuse_file_as_folder,
    remove_file,
    within,
)
from pipelines.storage.provenance import is_finished, make_stamp

STAGE = "export-coco"
IMAGES = ("rgb", "depth")


@one_run_at_a_time(STAGE, "output_dir")
def run(
    source: Path,
    output_dir: Path,
    config: ExportCocoConfig,
    *,
    split: str | None = "train",
    camera: str | None = None,
    seed: int = 0,
    options: BatchOptions | None = None,
) -> StageReport:
    """Export every scene of `split` (None: all), then join the scenes of each COCO split."""
    options = options or BatchOptions()
    refuse_file_as_folder(output_dir)
    check_settings(config)
    root = GraspNetRoot.finished(source)
    scenes = root.chosen_scenes(camera, split)
    items = [
        _item(scene, output_dir, config, inputs)
        for scene, inputs in zip(scenes, inputs_of_scenes(root, scenes), strict=True)
    ]
    splits = _splits(items, output_dir, config, seed)
    _refuse_stale(splits, items, options)
    report = run_batch(STAGE, items, partial(export_scene, root=root, config=config), options)
    if report.failed:
        # Without the failed scenes the split would differ: training scenes might validate a model.
        count = f"{len(report.failed)} of {counted(len(items), 'scene')} failed"
        report.notes["splits"] = f"not joined to annotations/, as {count}"
        report.has_next = False
    elif not options.dry_run:
        report.notes["splits"] = _join(splits, config, options)
        report.has_next = all(split.arguments for split in splits)
    return report


def export_scene(item: WorkItem, root: GraspNetRoot, config: ExportCocoConfig) -> str:
    """Export one scene; `item.arguments`: its files and the output folder."""
    scene, output_dir = item.arguments
    folder = _images_of(scene, output_dir)
    for name in ("camK.npy", "rgb/0000.png", "depth/0000.png"):
        within(output_dir, folder / name)
    images, annotations = [], []
    _place(scene.camera_folder / "camK.npy", folder / "camK.npy", link=config.link)
    for files in strided_frames(scene, config.frame_stride):
        shown = read_region_frame(root, files, config.min_pixels)
        copy = _copy_of(files, folder)
        for kind in IMAGES:
            _place(files.path(kind), copy.path(kind), link=config.link)
        height, width = shown.frame.color.shape[:2]
        image = coco_instances.image_entry(copy, width, height)
        images.append(image)
        annotations += [
            coco_instances.annotation_entry(
                image, number, region, coco_instances.category_of(region, config.categories)
            )
            for number, region in enumerate(shown.regions, start=1)
        ]
    categories = coco_instances.category_entries(config.categories, scene.object_ids)
    coco_instances.write(item.target, images, annotations, categories, item.stamp)
    return f"{counted(len(annotations), 'region')} in {counted(len(images), 'frame')}"


def _splits(
    items: Sequence[WorkItem], output_dir: Path, config: ExportCocoConfig, seed: int
) -> list[WorkItem]:
    """Return the annotation files of both splits; scenes seen by two cameras stay together.

    `arguments`: the items of a split's scenes. The stamps are known before any scene is exported,
    so that other settings are refused before anything is written.
    """
    held_out = held_out_scenes([_scene_name(i) for i in items], config.val_fraction, seed)
    splits = []
    for split in coco_instances.COCO_SPLITS:
        mine = tuple(i for i in items if (_scene_name(i) in held_out) == (split == "val"))
        inputs = {item.name: item.stamp.as_digest() for item in mine}
        stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
        path = coco_instances.annotations_path(output_dir, split)
        splits.append(WorkItem(split, path, stamp, mine))
    return splits


def _refuse_stale(
    splits: Sequence[WorkItem], items: Sequence[WorkItem], options: BatchOptions
) -> None:
    """Refuse to replace the annotations of an earlier run, before any scene is exported.

    Stale scenes are reported one by one instead, which is more precise.
    """
    refusals = [why for split in splits if (why := _refusal(split, options)) is not None]
    if refusals and all(_refusal(item, options) is None for item in items):
        raise refusals[0]


def _refusal(item: WorkItem, options: BatchOptions) -> SymgraspError | None:
    try:
        is_finished(item.target, item.stamp, overwrite=options.overwrite)
    except SymgraspError as error:
        return error
    return None


def _join(splits: Sequence[WorkItem], config: ExportCocoConfig, options: BatchOptions) -> str:
    """Write the annotation files of both splits from those of their scenes. Return the counts."""
    items = [item for split in splits for item in split.arguments]
    object_ids = {object_id for item in items for object_id in item.arguments[0].object_ids}
    categories = coco_instances.category_entries(config.categories, object_ids)
    counts = []
    for split in splits:
        entries = [coco_instances.read_entries(item.target) for item in split.arguments]
        images = [image for some, _ in entries for image in some]
        annotations = [annotation for _, more in entries for annotation in more]
        if not is_finished(split.target, split.stamp, overwrite=options.overwrite):
            coco_instances.write(split.target, images, annotations, categories, split.stamp)
        found = f"{counted(len(images), 'image')}, {counted(len(annotations), 'region')}"
        counts.append(f"{split.name}: {found}")
    return "; ".join(counts)


def _scene_name(item: WorkItem) -> str:
    scene: SceneFiles = item.arguments[0]
    return scene.folder.name


def _place(source: Path, target: Path, *, link: bool) -> None:
    """Copy or link the file `source` to `target`, atomically."""
    existing(source)
    if link:
        make_folder(target.parent)
        remove_file(target)
        target.symlink_to(real_path(source))
        return
    remove_file(target)  # writing through a link of an earlier run would change `source`
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)


def _item(
    scene: SceneFiles, output_dir: Path, config: ExportCocoConfig, inputs: Mapping[str, str]
) -> WorkItem:
    settings = {key: value for key, value in asdict(config).items() if key != "val_fraction"}
    stamp = make_stamp(STAGE, settings, inputs=inputs)
    target = output_dir / "scenes" / f"{scene.name}.json"
    folder = _images_of(scene, output_dir)
    copies = [_copy_of(files, folder) for files in strided_frames(scene, config.frame_stride)]
    images = [copy.path(kind) for copy in copies for kind in IMAGES]
    files = (folder / "camK.npy", *images)
    return WorkItem(scene.name, target, stamp, (scene, output_dir), files)


def _images_of(scene: SceneFiles, output_dir: Path) -> Path:
    return output_dir / "images" / scene.folder.name / scene.camera


def _copy_of(files: FrameFiles, folder: Path) -> FrameFiles:
    return FrameFiles(folder, files.scene_id, files.camera, files.frame_id)
