"""Optional outputs of finished annotations: contact sheets, BOP's models_info.json."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipelines.annotation.jobs import STAGE, mesh_of
from pipelines.dataset.symmetry import bop_models_info, symmetry_labels
from pipelines.errors import StaleOutputError, counted
from pipelines.pictures import contact_sheet
from pipelines.pictures.symmetry_pictures import object_views
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.storage.files import read_json
from pipelines.storage.images import read_image, write_image
from pipelines.storage.provenance import (
    Stamp,
    digest,
    make_stamp,
    read_stamp,
    sidecar_of,
    stamp_ahead,
    write_sidecar,
)

PICTURES = "annotate-symmetry, pictures"


@dataclass(frozen=True)
class AnnotationExtras:
    """Optional inputs and outputs of `annotate-symmetry`."""

    edits: Path | None = None  # corrections by hand
    bop_symmetries: Path | None = None  # models_info.json: rotations to replace detected ones
    bop: Path | None = None  # models_info.json to write
    pictures: Path | None = None  # folder for contact sheets


def write_extras(
    report: StageReport,
    items: Sequence[WorkItem],
    extras: AnnotationExtras,
    options: BatchOptions,
) -> None:
    """Write the contact sheets and BOP's file from all finished annotations."""
    finished = [i for i in items if i.name not in report.failed and i.target.is_file()]
    if extras.pictures is not None and finished:
        _write_pictures(report, finished, extras.pictures, options)
    if extras.bop is not None and finished:
        _write_bop(finished, extras.bop, overwrite=options.overwrite)


def _write_pictures(
    report: StageReport,
    items: Sequence[WorkItem],
    folder: Path,
    options: BatchOptions,
) -> None:
    """Draw every annotated object and the contact sheets, unless they are up to date."""
    stamp = _stamp_of_all(PICTURES, items)
    drawings = [
        WorkItem(
            f"picture of {item.name}",
            folder / "objects" / f"{item.name}.png",
            stamp,
            (item.arguments[0], item.target),
        )
        for item in items
    ]
    wanted = [*contact_sheet.page_paths(folder, len(items)), *(each.target for each in drawings)]
    is_whole = all(path.is_file() for path in wanted)
    if is_whole and read_stamp(folder) == stamp.as_json():
        return
    drawn = run_batch(PICTURES, drawings, draw_file, replace(options, overwrite=True))
    report.failed |= drawn.failed
    tiles = [
        contact_sheet.Tile(
            item.name,
            read_image(drawing.target),
            symmetry_labels.read(item.target),
            f"objects/{drawing.target.name}",
        )
        for item, drawing in zip(items, drawings, strict=True)
        if drawing.name not in drawn.failed
    ]
    pages = contact_sheet.write_sheets(folder, tiles)
    if not drawn.failed:  # the next run draws again what failed
        write_sidecar(folder, stamp)
    drawn_on = counted(len(pages), "sheet")
    report.notes["pictures"] = f"{counted(len(tiles), 'object')} on {drawn_on}, {folder}"


def _write_bop(items: Sequence[WorkItem], path: Path, *, overwrite: bool) -> None:
    """Write BOP's file; a file of another origin is only replaced with `overwrite`."""
    sidecar = sidecar_of(path)
    ours = sidecar.is_file() and read_json(sidecar).get("stage") == STAGE
    if path.exists() and not ours and not overwrite:
        raise StaleOutputError(path)
    objects = {
        item.name: (
            mesh_of(item.arguments[0]),
            symmetry_labels.read(item.target).symmetries,
        )
        for item in items
    }
    stamp_ahead(path, _stamp_of_all(STAGE, items))
    bop_models_info.write(path, objects)


def _stamp_of_all(stage: str, items: Sequence[WorkItem]) -> Stamp:
    return make_stamp(stage, {}, inputs={item.name: digest(item.target) for item in items})


def draw_file(item: WorkItem) -> None:
    """Draw one annotated object; `item.arguments`: its `Job` and its annotation."""
    job, labels_path = item.arguments
    write_image(item.target, object_views(mesh_of(job), symmetry_labels.read(labels_path)))
