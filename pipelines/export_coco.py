"""export-coco: masks of symmetric regions as a COCO instance dataset (Sec. III-D).

Reads   ROOT/scenes/scene_NNNN/CAMERA/{rgb,depth,label,annotations,camK.npy}
        ROOT/symmetry/NNN.json   regions, from annotate-symmetry
Writes  DIR/annotations/instances_{train,val}.json, DIR/images/, DIR/scenes/
"""

import shutil
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import ExportCocoConfig
from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.formats import coco_instances
from pipelines.formats.files import atomic_path
from pipelines.formats.graspnet import FrameFiles, GraspNetRoot, SceneFiles
from pipelines.formats.provenance import digest, make_stamp
from pipelines.formats.region_frames import held_out_scenes, read_region_frame
from pipelines.formats.scene_digests import digest_of_frames

STAGE = "export-coco"


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
    """Export every scene of `split` (None: all), then join those of training and validation."""
    options = options or BatchOptions()
    if config.categories not in coco_instances.CATEGORIES:
        raise UnknownNameError("categories", config.categories, coco_instances.CATEGORIES)
    root = GraspNetRoot(source)
    scenes = root.scenes(camera, split)
    if not scenes:
        wanted = f"{split or 'any'} scene" + (f" seen by {camera}" if camera else "")
        raise SymgraspError(f"{source} holds no {wanted}; name another --split or --camera")
    items = [_item(root, scene, output_dir, config) for scene in scenes]
    report = run_batch(STAGE, items, partial(export_scene, root=root, config=config), options)
    finished = [item for item in items if item.name not in report.failed]
    if not options.dry_run and finished:
        report.notes["splits"] = _join(root, finished, output_dir, config, seed)
    return report


def export_scene(item: WorkItem, root: GraspNetRoot, config: ExportCocoConfig) -> str:
    """Export one scene; `item.arguments` are its files and the dataset's folder."""
    scene, output_dir = item.arguments
    folder = output_dir / "images" / scene.folder.name / scene.camera
    images, annotations = [], []
    _place(scene.camera_folder / "camK.npy", folder / "camK.npy", link=config.link)
    for files in scene.frames()[:: config.frame_stride]:
        shown = read_region_frame(root, files, config.min_pixels)
        copy = FrameFiles(folder, files.scene_id, files.camera, files.frame_id)
        for kind in ("rgb", "depth"):
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
    return f"{len(annotations)} regions in {len(images)} frames"


def _join(
    root: GraspNetRoot,
    items: Sequence[WorkItem],
    output_dir: Path,
    config: ExportCocoConfig,
    seed: int,
) -> str:
    """Write the annotation files of both splits; scenes seen by two cameras stay together."""
    held_out = held_out_scenes([_scene_name(i) for i in items], config.val_fraction, seed)
    object_ids = {object_id for item in items for object_id in item.arguments[0].object_ids}
    categories = coco_instances.category_entries(config.categories, object_ids)
    counts = []
    for split in coco_instances.SPLITS:
        mine = [i for i in items if (_scene_name(i) in held_out) == (split == "val")]
        images, annotations = [], []
        for item in mine:
            some, more = coco_instances.read_entries(item.target)
            images += some
            annotations += more
        inputs = {item.name: digest(item.target) for item in mine}
        stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
        path = coco_instances.annotations_path(output_dir, split)
        coco_instances.write(path, images, annotations, categories, stamp)
        counts.append(f"{split}: {len(images)} images, {len(annotations)} regions")
    return "; ".join(counts)


def _scene_name(item: WorkItem) -> str:
    scene: SceneFiles = item.arguments[0]
    return scene.folder.name


def _place(source: Path, target: Path, *, link: bool) -> None:
    """Copy or link `source` to `target`, whole or not at all."""
    if link:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.unlink(missing_ok=True)
        target.symlink_to(source.resolve())
        return
    target.unlink(missing_ok=True)  # a link of an earlier run would be written through
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)


def _item(
    root: GraspNetRoot, scene: SceneFiles, output_dir: Path, config: ExportCocoConfig
) -> WorkItem:
    inputs = {"frames": digest_of_frames(scene)}
    for object_id in scene.object_ids:
        path = root.symmetry_path(object_id)
        # A label that is not there fails its scenes, when it is read.
        inputs[path.name] = digest(path) if path.is_file() else "missing"
    name = f"{scene.folder.name}_{scene.camera}"
    settings = {key: value for key, value in asdict(config).items() if key != "val_fraction"}
    stamp = make_stamp(STAGE, settings, inputs=inputs)
    return WorkItem(name, output_dir / "scenes" / f"{name}.json", stamp, (scene, output_dir))
