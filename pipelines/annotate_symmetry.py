"""Stage `annotate-symmetry`: symmetries and symmetric regions of meshes (Sec. III-D, III-G).

Reads   ROOT/models/NNN/nontextured.ply   a dataset, or any mesh or folder of meshes
        ROOT/regions/NNN.json             optional regions by hand, which replace detected regions
        optional corrections by hand, and BOP's symmetries
Writes  ROOT/symmetry/NNN.json            symmetries and regions, canonical frame
        or OUT/NAME.json                  for loose meshes
        optional contact sheets, and BOP's models_info.json
"""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pipelines.annotation import jobs
from pipelines.annotation.extras import AnnotationExtras, write_extras
from pipelines.annotation.objects import annotate, correct
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.dataset.symmetry import bop_models_info, symmetry_edits, symmetry_labels
from pipelines.dataset.symmetry.symmetry_edits import ObjectEdits
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.errors import SymgraspError
from pipelines.mesh_symmetry.parts.symmetric_parts import has_slot
from pipelines.pictures import contact_sheet
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import output_locked
from pipelines.storage.files import refuse_file_as_folder


def run(
    source: Path,
    output_dir: Path | None,
    config: AnnotateSymmetryConfig,
    *,
    extras: AnnotationExtras | None = None,
    seed: int = 0,
    mesh_scale: float | None = None,
    options: BatchOptions | None = None,
) -> StageReport:
    """Annotate a dataset root in place, or a mesh or a folder of meshes into `output_dir`.

    `mesh_scale`: metres per unit of the meshes; None is 1 and refuses implausibly large meshes.
    """
    extras, options = extras or AnnotationExtras(), options or BatchOptions()
    if extras.pictures is not None:
        refuse_file_as_folder(extras.pictures)
        contact_sheet.refuse_other_index(extras.pictures)
    optional = jobs.OptionalInputs(
        edits={} if extras.edits is None else symmetry_edits.read(extras.edits),
        bop={} if extras.bop_symmetries is None else bop_models_info.read(extras.bop_symmetries),
        scale=mesh_scale,
    )
    items = jobs.items_of(source, output_dir, config, seed, optional)
    bop = extras.bop_symmetries
    missing = [] if bop is None else jobs.without_bop_entry(items, bop, optional)
    # The symmetries of a dataset may also be the --out of loose meshes, so its folder is locked.
    folder = items[0].target.parent
    with output_locked(folder, jobs.STAGE) if not options.dry_run else nullcontext():
        report = _annotate_all(items, config, seed, options)
        _refuse_unknown(report, optional.edits, [item.name for item in items])
        if bop is not None and missing:
            found = f"has no entry of {', '.join(missing)}; detected symmetries stay"
            report.notes[bop.name] = found
        if not options.dry_run:
            write_extras(report, items, extras, options)
    return report


def _annotate_all(
    items: Sequence[WorkItem], config: AnnotateSymmetryConfig, seed: int, options: BatchOptions
) -> StageReport:
    """Annotate all objects; apply corrections to finished annotations; the others stay."""
    step = partial(annotate_file, config=config, seed=seed)
    to_correct = {item.name for item in items if jobs.is_to_correct(item)}
    report = run_batch(jobs.STAGE, [i for i in items if i.name not in to_correct], step, options)
    corrections = [item for item in items if item.name in to_correct]
    report.add(run_batch(jobs.STAGE, corrections, step, replace(options, overwrite=True)))
    return report


def annotate_file(item: WorkItem, config: AnnotateSymmetryConfig, seed: int) -> str:
    """Annotate one mesh file, or correct its annotation; `item.arguments`: its inputs."""
    job: jobs.ObjectInputs = item.arguments[0]
    if job.refusal is not None:
        raise SymgraspError(job.refusal)
    if job.edits is None and jobs.edits_of(item.target) is not None:
        raise SymgraspError(
            f"{item.target} holds corrections by hand, which would be lost; "
            "pass them again with --edit, or delete the file"
        )
    mesh, rng = jobs.mesh_of(job), np.random.default_rng(seed)
    if job.edits is not None and jobs.is_to_correct(item):
        labels = symmetry_labels.read(item.target)
        labels, notes = correct(mesh, labels, job.edits, config, rng, job.regions)
    else:
        given = [] if job.bop is None else bop_models_info.symmetries_of(job.bop, mesh)
        labels, notes = annotate(
            mesh, item.name, config, rng,
            regions_path=job.regions, given=given, edits=job.edits,
        )  # fmt: skip
    symmetry_labels.write(item.target, labels, item.stamp)
    return "; ".join([_summary(labels), *notes])


def _refuse_unknown(
    report: StageReport, edits: dict[str, ObjectEdits], names: Sequence[str]
) -> None:
    for name in sorted(set(edits) - set(names)):
        report.failed[name] = (
            f"{edits[name].path} corrects {name}, which does not exist; "
            f"the objects are {', '.join(sorted(names))}"
        )


def _summary(labels: ObjectSymmetries) -> str:
    kinds = [symmetry.kind for symmetry in labels.symmetries]
    counts = [f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)]
    text = ", ".join(counts) or "no symmetry"
    if has_slot(labels.symmetries) and len(labels.regions) == 1:
        return text
    return f"{text}; regions: {', '.join(region.name for region in labels.regions) or 'none'}"
