"""Stage `score-grasps`: verdicts on any grasps on any mesh (Sec. IV-A).

Reads   MESH            scaled to metres
        MESH's .sdf     next to it, if it exists, with `compatible`: graspnetAPI reads both
        GRASPS.npy      (N, 17) graspnetAPI's rows, in the mesh's frame
Writes  VERDICTS.npz    contacts, smallest friction, antipodal score, collision: one row per grasp
        VERDICTS.npz.provenance.json
"""

import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.configs import ScoreGraspsConfig
from pipelines.dataset.graspnet.signed_distance import read_sdf
from pipelines.dataset.meshes import read_own_mesh
from pipelines.errors import counted
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid
from pipelines.geometry.meshes.winding import turned_outward
from pipelines.geometry.numerics.single_precision import single_precision_grid
from pipelines.grasp_files.grasp_rows import read_grasp_rows, write_verdicts
from pipelines.grasping.grasps import RowColumn, from_graspnet
from pipelines.metrics.antipodal import contact_pair_score
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid
from pipelines.metrics.graspnet.box_collision import cloud_collision, exact_collision
from pipelines.metrics.graspnet.grid_contacts import close_fingers_on_grid
from pipelines.runtime.batch import StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import existing
from pipelines.storage.provenance import (
    digest,
    is_finished,
    make_stamp,
    refuse_foreign,
    refuse_other_suffix,
)

STAGE = "score-grasps"
NAMED_FAULTS = 5
ROUNDING = 1e-6  # metres; openings beyond the limit by less are equal to it
CLIPPED = "clipped to {width:g} m: {count}; --clip-width states the gripper's widest opening"
FAR = 1.0  # metres; a note is given if even the nearest grasp is farther from the mesh
UNSURE = "is not closed; near its holes the distance grid and the verdicts are unreliable"


@one_run_at_a_time(STAGE, "output")
def run(
    model: Path,
    grasps: Path,
    output: Path,
    config: ScoreGraspsConfig,
    *,
    mesh_scale: float | None = None,
    overwrite: bool = False,
) -> StageReport:
    """Score the rows of `grasps` on the mesh `model`; rows that are no grasps are reported.

    `mesh_scale`: metres per unit of the mesh; None is 1 and refuses an implausibly large mesh.

    Raises:
        ValueRangeError: `output` is not named .npz.
    """
    refuse_other_suffix(output, ".npz")
    started, report = time.monotonic(), StageReport(STAGE)
    inputs = {"mesh": digest(existing(model)), "grasps": digest(existing(grasps))}
    stored = model.with_suffix(".sdf")
    with_grid = config.compatible and mesh_scale in (None, 1.0) and stored.is_file()
    if with_grid:
        inputs["sdf"] = digest(stored)
    settings = {**asdict(config), "mesh_scale": mesh_scale or 1.0}
    stamp = make_stamp(STAGE, settings, inputs=inputs)
    refuse_foreign(output, STAGE)
    if is_finished(output, stamp, overwrite=overwrite):
        report.skipped.append(output.name)
        return report
    mesh, turned = turned_outward(read_own_mesh(model, mesh_scale))
    given = read_grasp_rows(grasps)
    verdicts = score(mesh, given.rows, config, read_sdf(stored) if with_grid else None)
    _forget(verdicts, sorted(given.faults))
    write_verdicts(output, verdicts, stamp)
    report.done.append(output.name)
    report.notes[output.name] = _summary(verdicts)
    rows = np.delete(given.rows, sorted(given.faults), axis=0)
    if note := "; ".join(_oddities(mesh, rows, config.clip_width)):
        report.notes[grasps.name] = note
    unsure = config.compatible and not with_grid and not mesh.is_watertight
    if turned or unsure:
        report.notes[model.name] = "; ".join(filter(None, (turned, UNSURE if unsure else "")))
    for row in sorted(given.faults)[:NAMED_FAULTS]:
        report.failed[f"row {row}"] = f"{grasps} {given.faults[row]}; it is scored as failed"
    if len(given.faults) > NAMED_FAULTS:
        report.failed["other rows"] = f"{len(given.faults) - NAMED_FAULTS} more are no grasps"
    report.seconds = time.monotonic() - started
    return report


def score(
    mesh: Mesh, rows: Array, config: ScoreGraspsConfig, grid: SignedDistanceGrid | None = None
) -> dict[str, NDArray[np.generic]]:
    """Return the verdicts on `rows` (n, 17), mesh frame, metres; see `VERDICT_ARRAYS`.

    With `compatible`, contacts, friction grid and collision are as graspnetAPI finds them, its
    faults included, on `grid` or on a grid computed from the mesh. Otherwise contacts are exact
    intersections, and collision is tested on triangles.
    """
    clipped = rows.copy()
    clipped[:, RowColumn.WIDTH] = np.clip(rows[:, RowColumn.WIDTH], 0.0, config.clip_width)
    grasps = from_graspnet(clipped)  # translation is between the finger tips
    if config.compatible:
        contacts = close_fingers_on_grid(grid or single_precision_grid(mesh), grasps, grasps.width)
        collision, empty = cloud_collision(mesh, grasps, rows[:, RowColumn.DEPTH])
    else:
        contacts = close_fingers(mesh, grasps, grasps.width)
        collision, empty = exact_collision(mesh, grasps, rows[:, RowColumn.DEPTH])
        empty &= ~contacts.found  # samples of a large surface may miss the points of contact
    smallest = min_friction(contacts)
    stepped = on_grid(smallest, config.friction_grid)
    return {
        "min_friction": np.where(contacts.found, smallest, np.nan),
        "min_friction_grid": np.where(np.isfinite(stepped), stepped, -1.0),
        "contacts": contacts.points,
        "normals": contacts.normals,
        "found": contacts.found,
        "antipodal": contact_pair_score(contacts),
        "collision": collision,
        "empty": empty,
    }


def _oddities(mesh: Mesh, rows: Array, clip_width: float) -> Iterator[str]:
    """Yield sentences on `rows` (n, 17) that are too far from the mesh, or too wide."""
    low, high = mesh.bounds
    places = rows[:, RowColumn.TRANSLATION]
    gaps = np.linalg.norm(np.maximum(np.maximum(low - places, places - high), 0.0), axis=1)
    if len(gaps) and (nearest := float(gaps.min())) > FAR:
        yield (
            f"the nearest grasp is {nearest:.3g} m from the mesh; "
            "translations are metres in the mesh's frame"
        )
    wider = np.count_nonzero(rows[:, RowColumn.WIDTH] > clip_width + ROUNDING)
    if wider:
        yield CLIPPED.format(count=counted(int(wider), "opening"), width=clip_width)


def _forget(verdicts: dict[str, NDArray[np.generic]], rows: list[int]) -> None:
    """Set the verdicts on rows that are no grasps to failure, in place."""
    for name, failed in (
        ("min_friction", np.nan),
        ("min_friction_grid", -1.0),
        ("contacts", np.nan),
        ("normals", np.nan),
        ("found", False),
        ("antipodal", 0.0),
        ("collision", True),
        ("empty", True),
    ):
        verdicts[name][rows] = failed


def _summary(verdicts: dict[str, NDArray[np.generic]]) -> str:
    found = verdicts["found"].astype(bool)
    held = verdicts["min_friction_grid"].astype(np.float64) > 0.0
    free = ~verdicts["collision"].astype(bool)
    return (
        f"{counted(len(found), 'grasp')}, {found.sum()} with contact of both fingers, {held.sum()} "
        "in force closure at a friction of the grid, "
        f"{(held & free).sum()} of them without collision"
    )
