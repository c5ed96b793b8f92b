"""Stage `synthesize`: procedural scenes in GraspNet-1Billion's layout.

Reads   nothing, or a folder of meshes (`--models`)
Writes  ROOT/models/NNN/                     nontextured.ply, textured.obj, convex.npz; with `--sdf`
                                             textured.sdf, dex-net's distance grid
        ROOT/grasp_label/NNN_labels.npz      sampled and validated on GraspNet's grid
        ROOT/scenes/scene_NNNN/CAMERA/       rgb, depth, label, annotations, meta, poses;
                                             rect if there are collision labels
        ROOT/scenes/.../surroundings.npz     bin, walls and similar objects, if there are any
        ROOT/collision_label/scene_NNNN/     collisions of labelled grasps with the scene
        ROOT/objects.json                    family, pool and true symmetries of each object

Scenes are numbered by GraspNet's splits; if a split has more scenes than GraspNet's, its numbers
continue 1000 above. The objects depend on the seed only, so a training root and a test root of one
seed share exactly the objects of the seen pool, and no scene.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from pipelines.configs import SynthesizeConfig
from pipelines.dataset import convex_pieces as convex_file
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import write_grasp_label
from pipelines.dataset.graspnet.graspnet_layout import SPLIT_BLOCKS, SPLITS, scenes_of_split
from pipelines.dataset.graspnet.signed_distance import write_sdf
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import UnknownNameError, ValueRangeError
from pipelines.geometry.meshes.signed_distance import signed_distance_grid
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import atomic_folder, refuse_file_as_folder
from pipelines.storage.provenance import digest_if_there, make_stamp, stamp_ahead, write_sidecar
from pipelines.storage.unfinished import mark_finished, mark_unfinished
from pipelines.synthesis.labels.grasp_sampling import sample_grasp_label
from pipelines.synthesis.objects.own_models import OwnModel, own_models, refuse_own_output
from pipelines.synthesis.objects.pools import POOLS_OF_FAMILIES, make_object
from pipelines.synthesis.objects.shown_objects import refuse_to_replace_shown
from pipelines.synthesis.scenes.cameras import MIXED, camera_folder
from pipelines.synthesis.scenes.scene_files import files_of_scene, write_scene
from pipelines.synthesis.scenes.tables import check_object_counts

STAGE = "synthesize"
MODEL_FILES = ("nontextured.ply", "textured.obj", "convex.npz")
PLACE_OF_SPLIT = {"train": 0, "seen": 0, "similar": 1, "novel": 2}  # in POOLS_OF_FAMILIES
MAX_OBJECTS = 9999  # label images have 16 bits if needed; names of models have up to four digits
CONTAINER_FLOORS = 2  # in stamps; scenes without it are older, their objects may be in the floors
TAG_LABEL = 1  # purpose of a child seed; scenes use other tags


@one_run_at_a_time("synthesize", "output")
def run(
    output: Path,
    config: SynthesizeConfig,
    options: BatchOptions,
    *,
    seed: int = 0,
    models: Path | None = None,
    mesh_scale: float | None = None,
    sdf: bool = False,
) -> StageReport:
    """Write a dataset to `output`: objects first, then scenes; finished items are kept.

    `models`: meshes to use instead of procedural objects. `mesh_scale`: metres per unit of the
    meshes; None is 1 and refuses implausibly large meshes. `sdf`: write `textured.sdf` too.

    Raises:
        ValueRangeError: a setting is out of range, or `models` are those of `output`.
        SymgraspError: a scene of an earlier run shows objects that this run would replace.
    """
    refuse_file_as_folder(output)
    _check(config, models, output)
    sources = own_models(models, mesh_scale) if models else []
    root = _PlannedRoot(
        GraspNetRoot(output), config, seed, _object_ids(config, len(sources)), sources
    )
    if options.overwrite:
        root.refuse_to_replace_shown()
    was_finished = not options.dry_run and mark_unfinished(output, STAGE)
    report = StageReport(STAGE)
    if models and _chooses_objects(config):
        report.notes["objects"] = (
            f"all meshes of {models} are used; --objects and --families choose procedural objects"
        )
    step = partial(_write_object, seed=seed)
    report.add(run_batch("synthesize objects", root.object_items(), step, options))
    if config.labels.num_points and not report.failed:
        label = partial(_write_label, seed=seed, config=config)
        report.add(run_batch("synthesize labels", root.label_items(), label, options))
    if sdf and not report.failed:
        report.add(run_batch("synthesize distance grids", root.grid_items(), _write_grid, options))
    if report.failed:
        report.notes["scenes"] = "scenes are made once all objects and their labels are finished"
        return report
    if not options.dry_run:
        root.write_object_list()
    scene = partial(_write_scene, config=config)
    report.add(run_batch("synthesize scenes", root.scene_items(), scene, options))
    if not options.dry_run and (not report.failed or (was_finished and not report.done)):
        mark_finished(output, STAGE)
    return report


def _check(config: SynthesizeConfig, models: Path | None, output: Path) -> None:
    if models:
        refuse_own_output(models, output)
    for split in config.splits:
        if split not in SPLITS:
            raise UnknownNameError("split", split, SPLITS)
        most = len(SPLITS[split]) * SPLIT_BLOCKS
        if config.scenes_per_split > most:
            raise ValueRangeError(
                "--scenes-per-split", config.scenes_per_split, f"at most {most} for {split}"
            )
        if models and PLACE_OF_SPLIT[split] != 0:
            given, expected = ",".join(config.splits), "train, seen or both with --models"
            raise ValueRangeError("--split", given, f"{expected}, which is one pool of objects")
    most = MAX_OBJECTS // len(POOLS_OF_FAMILIES[config.families])
    if config.objects_per_pool > most:
        raise ValueRangeError("--objects", config.objects_per_pool, f"at most {most} a pool")
    check_object_counts(config.min_objects, config.max_objects)
    if config.sensor != MIXED:
        camera_folder(config.sensor)


def _chooses_objects(config: SynthesizeConfig) -> bool:
    """Return whether settings of procedural objects differ from their defaults."""
    usual, names = SynthesizeConfig(), ("objects_per_pool", "families")
    return any(getattr(config, name) != getattr(usual, name) for name in names)


def _object_ids(config: SynthesizeConfig, num_models: int) -> dict[int, tuple[str, int]]:
    """Return {object id: (pool, index in the pool)} of the pools that the splits need."""
    if num_models:
        if num_models > MAX_OBJECTS:
            raise ValueRangeError("number of meshes", num_models, f"at most {MAX_OBJECTS}")
        return {index: ("models", index) for index in range(num_models)}
    pools = POOLS_OF_FAMILIES[config.families]
    needed = sorted({PLACE_OF_SPLIT[split] for split in config.splits})
    count = config.objects_per_pool
    return {
        place * count + index: (pools[place], index) for place in needed for index in range(count)
    }


@dataclass(frozen=True)
class _PlannedRoot:
    """Objects and scenes to make in a root, from the user's meshes if there are any.

    `ids`: pool and place in the pool of each object, by its id. `sources`: the user's meshes by
    their place; empty for procedural objects.
    """

    files: GraspNetRoot
    config: SynthesizeConfig
    seed: int
    ids: dict[int, tuple[str, int]]
    sources: Sequence[OwnModel]

    def object_items(self) -> list[WorkItem]:
        items = []
        for object_id, (pool, index) in self.ids.items():
            source = self.sources[index] if self.sources else None
            count = self.config.objects_per_pool
            settings: dict[str, object] = {"pool": pool, "index": index, "count": count}
            if source and source.scale not in (None, 1.0):  # 1 is the default
                settings["mesh_scale"] = source.scale
            inputs = {"mesh": digest_if_there(source.path)} if source else {}
            stamp = make_stamp("synthesize object", settings, seed=self.seed, inputs=inputs)
            target, arguments = self.files.model_path(object_id).parent, (pool, index, source)
            files = tuple(target / name for name in MODEL_FILES)
            items.append(WorkItem(f"object {object_id:03d}", target, stamp, arguments, files))
        return items

    def write_object_list(self) -> None:
        """Write objects.json: these objects, and earlier records of other objects with models."""
        path = self.files.root / "objects.json"
        earlier = object_list.read(path) if path.is_file() else []
        listed = {r.object_id: r for r in earlier if self.files.model_path(r.object_id).is_file()}
        for object_id, (pool, index) in self.ids.items():
            if self.sources:
                name = self.sources[index].name
                listed[object_id] = ObjectRecord(object_id, name, name, pool)
                continue
            made = make_object(pool, index, self.seed)
            record = ObjectRecord(object_id, made.name, made.family, pool, made.symmetries)
            listed[object_id] = record
        pools = sorted({each.pool for each in listed.values()})
        settings = {"pools": pools, "count": self.config.objects_per_pool}
        stamp = make_stamp("synthesize object list", settings, seed=self.seed)
        object_list.write(path, list(listed.values()), stamp)

    def label_items(self) -> list[WorkItem]:
        items = []
        for object_id in sorted(self.ids):
            model = self.files.model_path(object_id)
            inputs = {model.name: digest_if_there(model)}
            settings = self.config.labels
            stamp = make_stamp("synthesize label", settings, seed=self.seed, inputs=inputs)
            target = self.files.grasp_label_path(object_id)
            items.append(WorkItem(f"label {object_id:03d}", target, stamp, (object_id, model)))
        return items

    def grid_items(self) -> list[WorkItem]:
        items = []
        for object_id in sorted(self.ids):
            model = self.files.model_path(object_id)
            inputs = {model.name: digest_if_there(model)}
            stamp = make_stamp("synthesize distance grid", {}, inputs=inputs)
            target = model.with_name("textured.sdf")
            items.append(WorkItem(f"distance grid {object_id:03d}", target, stamp, (model,)))
        return items

    def refuse_to_replace_shown(self) -> None:
        """Refuse to replace objects that scenes of earlier runs show."""
        count = self.config.scenes_per_split
        made_again = {i for split in self.config.splits for i in scenes_of_split(split)[:count]}
        models = dict(zip(self.ids, self.object_items(), strict=True))
        refuse_to_replace_shown(self.files, models, made_again)

    def scene_items(self) -> list[WorkItem]:
        # Procedural objects follow from the settings and the seed. A user's meshes do not; the
        # files in models/ depend on --mesh-scale too.
        models = [self.files.model_path(i) for i in self.ids] if self.sources else []
        inputs = {
            f"models/{path.parent.name}/{path.name}": digest_if_there(path) for path in models
        }
        settings = _scene_settings(self.config)
        stamp = make_stamp("synthesize scene", settings, seed=self.seed, inputs=inputs)
        items = []
        for split in self.config.splits:
            own = POOLS_OF_FAMILIES[self.config.families][PLACE_OF_SPLIT[split]]
            pool = "models" if self.sources else own
            members = tuple(i for i, (of, _) in self.ids.items() if of == pool)
            for scene_id in scenes_of_split(split)[: self.config.scenes_per_split]:
                target = self.files.scene_folder(scene_id)
                arguments = (self.files, scene_id, members)
                files = files_of_scene(self.files, scene_id, self.config, self.seed)
                items.append(WorkItem(f"scene {scene_id:04d}", target, stamp, arguments, files))
        return items


def _write_object(item: WorkItem, *, seed: int) -> None:
    pool, index, source = item.arguments
    made = source.as_object(seed) if source else make_object(pool, index, seed)
    with atomic_folder(item.target) as folder:
        plain, textured, pieces = (folder / name for name in MODEL_FILES)
        write_mesh(plain, made.mesh)
        write_mesh(textured, made.mesh)
        convex_file.write(pieces, made.pieces)
        write_sidecar(folder, item.stamp)


def _write_label(item: WorkItem, *, config: SynthesizeConfig, seed: int) -> None:
    object_id, model = item.arguments
    rng = np.random.default_rng([seed, TAG_LABEL, object_id])
    label = sample_grasp_label(read_mesh(model), config.labels, rng)
    stamp_ahead(item.target, item.stamp)
    write_grasp_label(item.target, label)


def _write_grid(item: WorkItem) -> None:
    (model,) = item.arguments
    grid = signed_distance_grid(read_mesh(model))
    stamp_ahead(item.target, item.stamp)
    write_sdf(item.target, grid)


def _scene_settings(config: SynthesizeConfig) -> dict[str, object]:
    """Return the settings in the stamp of a scene."""
    # The numbers of scenes and splits of a run do not change a scene.
    settings = asdict(replace(config, splits=(), scenes_per_split=0))
    usual = SynthesizeConfig()
    for name in ("scenery", "families"):  # older roots, which lack these settings, stay valid
        if getattr(config, name) == getattr(usual, name):
            del settings[name]
    if not {"bin", "tray"}.isdisjoint(config.scenery.surroundings):
        settings["container_floors"] = CONTAINER_FLOORS
    return settings


def _write_scene(item: WorkItem, *, config: SynthesizeConfig) -> str:
    root, scene_id, members = item.arguments
    return write_scene(root, scene_id, members, config, item.stamp)
