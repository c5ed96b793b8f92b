"""Stage `simulate`: trials of the grasps of a `grasps.h5` in physics (Sec. IV-A, Table III).

Reads   grasps.h5               from `infer`, run on a dataset in GraspNet-1Billion's layout
        ROOT/scenes, models     poses, labels, cameras, meshes, convex pieces
        ROOT/symmetry           from `annotate-symmetry`: kinds of the grasped regions
        ROOT/affordance         from `refine-grasps`, for the oracle among the baselines
Writes  success.json            rates by split, kind of symmetry and friction
        success.trials/         outcomes of all trials, one file per scene
        success.convex/NNN.npz  convex pieces of models that have none in the dataset

Every visible object of a frame gets one trial at each friction: with the grasp that `evaluate`
scores, and with `baselines` also with the grasps of the other methods on the same regions.
Finished scenes are not tried again. The dataset is not changed.
"""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path

from pipelines.configs import SimulateConfig
from pipelines.dataset import convex_pieces as convex_file
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.dataset.meshes import read_solid_mesh
from pipelines.evaluation.reports.tables import Table
from pipelines.evaluation.runs.other_runs import ComparedRuns, frames_by_row
from pipelines.evaluation.runs.trial_records import read_trials, trials_folder, write_trials
from pipelines.frames.graspnet_scene import annotated_ids
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, drop_stale, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.simulation.frames import FrameSimulator, PiecesReader
from pipelines.simulation.success import success_tables, write_success
from pipelines.storage.files import read_json
from pipelines.storage.provenance import (
    digest,
    digest_text,
    is_finished,
    make_stamp,
    refuse_foreign,
    refuse_other_suffix,
    stamp_ahead,
)
from pipelines.synthesis.objects.decomposition import is_nearly_convex, physics_pieces

LARGE_SHIFT = 0.01  # metres, more than rounding of poses causes


@one_run_at_a_time("simulate", "output")
def run(
    grasps: Path,
    dataset: Path,
    output: Path,
    config: SimulateConfig,
    options: BatchOptions,
    *,
    others: Sequence[Path] = (),
    baselines: bool = False,
    seed: int = 0,
) -> StageReport:
    """Try `grasps` in the scenes of `dataset`; write `output` and the folders next to it.

    `others`: further `grasps.h5` of the same frames, tried too. `baselines`: also try grasps
    planned with ground truth, from the boundary, and at random. `seed`: of coacd, which cuts models
    into convex pieces, and of the random baselines.

    Raises:
        ValueRangeError: `output` does not end in .json.
    """
    refuse_other_suffix(output, ".json")
    runs = ComparedRuns.of(grasps, others, dataset)
    scenes, reader = runs.scenes, PiecesReader(runs.root, pieces_folder(output))
    config = replace(config, gripper=runs.gripper(config.gripper))
    inputs = runs.inputs(config.gripper, baselines=baselines)
    object_ids = _object_ids(scenes)
    inputs["pieces"] = _digest_of_pieces(object_ids, reader)
    settings = {**asdict(config), "baselines": baselines}
    stamp = make_stamp("simulate", settings, seed=seed, inputs=inputs)
    refuse_foreign(output, "simulate")
    is_finished(output, stamp, overwrite=options.overwrite)  # raises if it is stale
    models = _model_items(object_ids, reader, config, seed)
    drop_stale(models, options)
    report = StageReport("simulate")
    report.add(run_batch("simulate models", models, functools.partial(_cut_model, config), options))
    items = runs.items(trials_folder(output), stamp, options)
    step = functools.partial(_simulate_scene, dataset, output, config, baselines)
    report.add(run_batch("simulate", items, step, options))
    report.notes |= runs.frames_notes() | runs.gripper_notes(config.gripper)
    finished = [item.target for item in items if item.target.exists()]
    if finished and not options.dry_run:
        trials = chain.from_iterable(map(read_trials, finished))
        write_success(output, trials, config.frictions, stamp, report.failed)
    return report


def tables(output: Path) -> list[Table]:
    """Return the tables of a written `success.json`."""
    return success_tables(read_json(output))


def pieces_folder(output: Path) -> Path:
    """Return the folder of convex pieces that the dataset lacks, which may be read-only."""
    return output.with_suffix(".convex")


def _model_items(
    object_ids: Iterable[int], reader: PiecesReader, config: SimulateConfig, seed: int
) -> list[WorkItem]:
    """Return one item for every object that has no convex pieces in the dataset."""
    settings = {
        name: getattr(config, name) for name in ("convex_enough", "concavity", "max_pieces")
    }
    items = []
    for object_id in object_ids:
        model, target = reader.source(object_id), reader.path(object_id)
        if model != target and model.is_file():
            inputs = {"mesh": digest(model)}
            stamp = make_stamp("simulate model", settings, seed=seed, inputs=inputs)
            items.append(WorkItem(f"model {object_id:03d}", target, stamp, (model,)))
    return items


def _cut_model(config: SimulateConfig, item: WorkItem) -> str | None:
    (model,) = item.arguments
    mesh = read_solid_mesh(model)
    pieces = physics_pieces(
        mesh,
        convex_enough=config.convex_enough,
        concavity=config.concavity,
        max_pieces=config.max_pieces,
        seed=item.stamp.seed,
    )
    stamp_ahead(item.target, item.stamp)
    convex_file.write(item.target, pieces)
    if len(pieces) > 1 or is_nearly_convex(mesh, config.convex_enough):
        return None
    return f"coacd cannot cut {model}: it is simulated as its convex hull, without cavities"


def _simulate_scene(
    dataset: Path, output: Path, config: SimulateConfig, baselines: bool, item: WorkItem
) -> str | None:
    root, gripper = GraspNetRoot(dataset), load_gripper(config.gripper)
    pieces = PiecesReader(root, pieces_folder(output))
    simulator = FrameSimulator(root, pieces, gripper, config, baselines, item.stamp.seed)
    frames = [simulator.run(each) for each in frames_by_row(*item.arguments)]
    write_trials(item.target, frames, item.stamp)
    farthest = max(frame.shift for frame in frames)
    if farthest < LARGE_SHIFT:
        return None
    return f"objects moved by up to {1000 * farthest:.0f} mm until they rested: check the poses"


def _digest_of_pieces(object_ids: Iterable[int], reader: PiecesReader) -> str:
    """Return the digest of the models' convex pieces, or of the meshes to be cut."""
    sources = [path for path in map(reader.source, object_ids) if path.is_file()]
    home = reader.root.root
    return digest_text("".join(f"{p.relative_to(home)} {digest(p)}\n" for p in sources))


def _object_ids(scenes: Iterable[SceneFiles]) -> list[int]:
    """Return the ids of the objects with a pose in `scenes`, as `evaluate` has them, ascending."""
    return sorted(
        {i for scene in scenes for i in annotated_ids(scene.camera_folder / "annotations")}
    )
