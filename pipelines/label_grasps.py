"""Stage `label-grasps`: grasp labels of any meshes, in GraspNet-1Billion's layout.

Reads   a mesh, a folder of meshes, or a dataset root with models/NNN/nontextured.ply
Writes  ROOT/models/NNN/              nontextured.ply, textured.obj: cleaned, metres; textured.sdf
        ROOT/grasp_label/NNN_labels.npz
        ROOT/objects.json             number NNN of each mesh

A mesh keeps its number as long as objects.json exists; further meshes get the next free numbers. An
object is labelled some points at a time by all workers; finished parts stay in NNN_labels.parts/,
so an interrupted run continues. ROOT may be the input root: its models then stay.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from pipelines.array_types import Singles
from pipelines.configs import LabelConfig, LabelGraspsConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import (
    is_compressed,
    join_grasp_labels,
    part_arrays,
    write_grasp_label,
)
from pipelines.dataset.graspnet.signed_distance import write_sdf
from pipelines.dataset.meshes import (
    clean_mesh,
    read_own_mesh,
    read_solid_mesh,
    smallness_warning,
    write_mesh,
)
from pipelines.dataset.numbered_meshes import NumberedMesh, numbered_meshes, write_object_list
from pipelines.errors import SymgraspError, ValueRangeError, WriteError, counted, error_sentence
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.meshes.signed_distance import signed_distance_grid
from pipelines.geometry.meshes.winding import turned_outward
from pipelines.runtime.batch import (
    BatchOptions,
    StageReport,
    WorkItem,
    run_batch,
    warn_of_removed,
)
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import (
    atomic_folder,
    make_folder,
    real_path,
    refuse_file_as_folder,
    remove_folder,
)
from pipelines.storage.provenance import (
    Stamp,
    digest_if_there,
    is_finished,
    make_stamp,
    read_stamp,
    stamp_ahead,
    write_sidecar,
)
from pipelines.storage.unfinished import mark_finished, mark_unfinished, refuse_unfinished
from pipelines.synthesis.labels.collision_notes import collision_note
from pipelines.synthesis.labels.grasp_sampling import LabelTarget, label_points

STAGE = "label-grasps"
POINTS_A_PART = 32
FILES_OF_PARTS = ("*.npz", "*provenance.json")
TAG_POINTS = 1  # purpose of a child seed


@one_run_at_a_time(STAGE, "output")
def run(
    meshes: Path,
    output: Path,
    config: LabelGraspsConfig,
    *,
    seed: int = 0,
    mesh_scale: float | None = None,
    sdf: bool = True,
    compress: bool = False,
    options: BatchOptions | None = None,
) -> StageReport:
    """Label `meshes` into the dataset root `output`; finished objects are kept.

    `mesh_scale`: metres per unit of the meshes; None is 1 and refuses implausibly large meshes.
    `sdf`: write textured.sdf too. `compress`: compress the labels.
    """
    options = options or BatchOptions()
    refuse_file_as_folder(output)
    root = GraspNetRoot(output)
    in_place = (meshes / "models").is_dir() and real_path(meshes) == real_path(output)
    if in_place and mesh_scale not in (None, 1.0):
        expected = "1 or left out for a root labelled in place, whose models are in metres"
        raise ValueRangeError("--mesh-scale", mesh_scale, expected)
    if not in_place:
        refuse_unfinished(meshes)
    sources = numbered_meshes(meshes, output)
    report = StageReport(STAGE)
    was_finished = not options.dry_run and mark_unfinished(output, STAGE)
    if not in_place:
        items = [_model_item(root, source, mesh_scale) for source in sources]
        sources = _run_step(report, sources, items, _write_model, options)
        if not options.dry_run:
            write_object_list(meshes, output, sources, STAGE)
    elif mesh_scale is None:
        sources = _in_metres(report, sources)
    if sdf and not options.dry_run:
        items = [_grid_item(root, source) for source in sources]
        sources = _run_step(report, sources, items, _write_grid, options)
    for number, source in enumerate(sources, start=1):
        _label(report, root, source, config, seed, compress, options, f"{number}/{len(sources)}")
    labelled = [source.object_id for source in sources if source.title in report.done]
    if note := collision_note(root, labelled):
        report.notes["collision labels"] = note
    if not options.dry_run and (not report.failed or (was_finished and not report.done)):
        mark_finished(output, STAGE)
    return report


def _in_metres(report: StageReport, sources: Sequence[NumberedMesh]) -> list[NumberedMesh]:
    """Return the models that are not too large for metres; the others fail."""
    read = StageReport(STAGE)
    for source in sources:
        with read.attempting(source.title):
            read_own_mesh(source.path, None)
    report.failed |= read.failed
    return [source for source in sources if source.title in read.done]


def _run_step(
    report: StageReport,
    sources: Sequence[NumberedMesh],
    items: Sequence[WorkItem],
    step: Callable[[WorkItem], str | None],
    options: BatchOptions,
) -> list[NumberedMesh]:
    """Run one step for every object, add it to `report`, and return the objects that passed."""
    part = run_batch(STAGE, items, step, options)
    report.add(replace(part, done=[], skipped=[]))
    return [source for source in sources if source.title not in part.failed]


def _model_item(root: GraspNetRoot, source: NumberedMesh, mesh_scale: float | None) -> WorkItem:
    # A missing mesh fails its own item, when it is read.
    inputs = {"mesh": digest_if_there(source.path)}
    stamp = make_stamp(f"{STAGE} model", {"mesh_scale": mesh_scale or 1.0}, inputs=inputs)
    model = root.model_path(source.object_id)
    files = (model, model.with_name("textured.obj"))
    return WorkItem(source.title, model.parent, stamp, (source.path, mesh_scale), files)


def _write_model(item: WorkItem) -> str:
    path, mesh_scale = item.arguments
    mesh, _, note = clean_mesh(read_own_mesh(path, mesh_scale))
    mesh, turned = turned_outward(mesh)
    with atomic_folder(item.target) as folder:
        write_mesh(folder / "nontextured.ply", mesh)
        write_mesh(folder / "textured.obj", mesh)
        write_sidecar(folder, item.stamp)
    return "; ".join(text for text in (note, turned) if text)


def _grid_item(root: GraspNetRoot, source: NumberedMesh) -> WorkItem:
    model = root.model_path(source.object_id)
    stamp = make_stamp(f"{STAGE} distance grid", {}, inputs={model.name: digest_if_there(model)})
    return WorkItem(source.title, model.with_name("textured.sdf"), stamp, (model,))


def _write_grid(item: WorkItem) -> None:
    (model,) = item.arguments
    grid = signed_distance_grid(read_solid_mesh(model))
    stamp_ahead(item.target, item.stamp)
    write_sdf(item.target, grid)


def _label(
    report: StageReport,
    root: GraspNetRoot,
    source: NumberedMesh,
    config: LabelGraspsConfig,
    seed: int,
    compress: bool,
    options: BatchOptions,
    progress: str,
) -> None:
    """Label one object with all workers, part by part, and add the result to `report`."""
    model, target = root.model_path(source.object_id), root.grasp_label_path(source.object_id)
    try:
        stamp = make_stamp(STAGE, config, seed=seed, inputs={model.name: digest_if_there(model)})
        if is_finished(target, stamp, overwrite=options.overwrite):
            _keep(report, source.title, target, compress=compress, dry_run=options.dry_run)
            return
        if options.dry_run:
            report.notes[source.title] = f"would write {target}"
            return
        mesh = read_solid_mesh(model)
        too_small = smallness_warning(mesh, source.path)
        labels = replace(config.labels, num_points=number_of_points(mesh, config))
        items = _part_items(model, target, stamp, labels.num_points)
        step = partial(_write_part, config=labels, seed=seed)
        parts = run_batch(
            f"{progress} {source.title}", items, step, replace(options, overwrite=False)
        )
        report.seconds += parts.seconds
        if parts.failed:
            raise SymgraspError(next(iter(parts.failed.values())))
        files = [item.target for item in items]
        summary = _summary(files)
        stamp_ahead(target, stamp)
        join_grasp_labels(target, files, compress=compress)
        remove_folder(files[0].parent, *FILES_OF_PARTS)
    except WriteError:
        raise
    except (SymgraspError, OSError) as error:
        report.failed[source.title] = error_sentence(error)
        return
    report.done.append(source.title)
    notes = (summary, too_small, report.notes.pop(source.title, ""))
    report.notes[source.title] = "; ".join(text for text in notes if text)


def _keep(report: StageReport, title: str, label: Path, *, compress: bool, dry_run: bool) -> None:
    """Add a finished label to `report`; `compress` it if it is not compressed yet."""
    if not compress or is_compressed(label):
        report.skipped.append(title)
        return
    if dry_run:
        report.notes[title] = f"would compress {label}"
        return
    join_grasp_labels(label, [label], compress=True)
    report.done.append(title)
    report.notes[title] = "its finished labels are compressed, and otherwise the same"


def number_of_points(mesh: Mesh, config: LabelGraspsConfig) -> int:
    """Return the number of grasp points of `mesh`: as configured, or by its area (D. 39)."""
    by_area = round(mesh.area / config.point_area)
    return config.labels.num_points or int(np.clip(by_area, config.min_points, config.max_points))


def _part_items(model: Path, target: Path, stamp: Stamp, num_points: int) -> list[WorkItem]:
    """Return the parts of a label; finished parts made with other settings are deleted."""
    folder = target.with_name(f"{target.stem}.parts")
    if folder.is_dir() and read_stamp(folder) != stamp.as_json():
        warn_of_removed(sorted(folder.glob("[!.]*.npz")))
        remove_folder(folder, *FILES_OF_PARTS)
    make_folder(folder)
    write_sidecar(folder, stamp)
    return [
        WorkItem(f"points {first} on", folder / f"{first:05d}.npz", stamp, (model, first))
        for first in range(0, num_points, POINTS_A_PART)
    ]


@lru_cache(maxsize=1)
def _prepared(model: Path, _digest: str, num_points: int, seed: int) -> tuple[LabelTarget, Singles]:
    """Return a model prepared for labelling, and its grasp points, the same in every worker."""
    mesh = read_solid_mesh(model)
    points = sample_surface(mesh, num_points, np.random.default_rng([seed, TAG_POINTS]))[0]
    return LabelTarget.from_mesh(mesh), points.astype(np.float32)


def _write_part(item: WorkItem, *, config: LabelConfig, seed: int) -> None:
    model, first = item.arguments
    prepared, points = _prepared(model, item.stamp.inputs[model.name], config.num_points, seed)
    label = label_points(prepared, points[first : first + POINTS_A_PART], config)
    stamp_ahead(item.target, item.stamp)
    write_grasp_label(item.target, label, compress=False)


def _summary(parts: Sequence[Path]) -> str:
    """Return a summary of a label: points, grasps that hold, grasps without collision."""
    points = sum(len(array) for array in part_arrays(parts, "points"))
    free = sum(int((~array).sum()) for array in part_arrays(parts, "collision"))
    holding = sum(int((array > 0.0).sum()) for array in part_arrays(parts, "scores"))
    hold = "1 grasp holds" if holding == 1 else f"{holding:,} grasps hold"
    return f"{counted(points, 'point')}, {hold}, {free:,} of them without collision"
