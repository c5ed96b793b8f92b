"""Stage `simulate`: try the grasps of a `grasps.h5` in physics (Sec. IV-A, Table III).

Reads   grasps.h5               of `infer`, run on a dataset in GraspNet-1Billion's layout
        ROOT/scenes, models     poses, labels, cameras, meshes, convex pieces
        ROOT/symmetry           of `annotate-symmetry`: what the grasped regions are like
Writes  success.json            rates by split, kind of symmetry and friction
        success.trials/         what became of every trial, one file a scene
        success.convex/NNN.npz  convex pieces of models that have none in the dataset

Every visible object of a frame gets one trial at each friction: the grasp that `evaluate` judges.
Scenes that are finished are not tried again. The dataset is only read.
"""

import functools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import SimulateConfig
from pipelines.errors import FormatError, StaleOutputError, SymgraspError
from pipelines.evaluation.tables import Table
from pipelines.formats import convex_pieces as convex_file
from pipelines.formats import grasps_file
from pipelines.formats.files import read_json
from pipelines.formats.graspnet import GraspNetRoot, SceneFiles
from pipelines.formats.grasps_file import FrameResult, GraspsFile
from pipelines.formats.gripper_files import load_gripper
from pipelines.formats.meshes import read_mesh
from pipelines.formats.provenance import (
    Stamp,
    digest,
    digest_folder,
    digest_text,
    is_finished,
    make_stamp,
    write_sidecar,
)
from pipelines.simulation.frames import FrameSimulator, PiecesReader
from pipelines.simulation.records import read_trials, write_trials
from pipelines.simulation.success import success_tables, write_success
from pipelines.synthesis.decomposition import convex_pieces

DEFAULT_GRIPPER = "rg2"


def run(
    grasps: Path,
    dataset: Path,
    output: Path,
    config: SimulateConfig,
    options: BatchOptions,
    *,
    seed: int = 0,
) -> StageReport:
    """Try `grasps` in the scenes of `dataset`; write `output` and what lies beside it.

    Args:
        grasps: a `grasps.h5`.
        dataset: root of the dataset that its frames are from.
        output: `success.json`.
        config: the hand, the trial, what counts as success.
        options: how the batch is run.
        seed: of coacd, which cuts models into convex pieces.
    """
    found, root = grasps_file.read(grasps), GraspNetRoot(dataset)
    config = replace(config, gripper=config.gripper or _gripper_used(found))
    load_gripper(config.gripper)  # an unknown one is refused before anything is done
    scenes = _by_scene(found, root, grasps)
    inputs = {"grasps": digest(grasps), **_digests(scenes, root, output)}
    stamp = make_stamp("simulate", config, seed=seed, inputs=inputs)
    is_finished(output, stamp, overwrite=options.overwrite)  # refuses to replace another
    models = _model_items(scenes, root, output, seed)
    _drop_stale(models, options)
    report = run_batch("simulate models", models, _cut_model, options)
    items = _scene_items(scenes, output, stamp)
    _drop_stale(items, options)
    step = functools.partial(_simulate_scene, dataset, output, config)
    report = _joined(report, run_batch("simulate", items, step, options))
    if not options.dry_run:
        frames = [f for item in items if item.target.exists() for f in read_trials(item.target)]
        write_success(output, frames, config.frictions, stamp)
    return report


def tables(output: Path) -> list[Table]:
    """Return the tables of a written `success.json`."""
    return success_tables(read_json(output))


def trials_folder(output: Path) -> Path:
    """Return where the trials of `output` lie, one file a scene."""
    return output.with_suffix(".trials")


def pieces_folder(output: Path) -> Path:
    """Return where convex pieces lie that the dataset lacks: it may be shared, or read-only."""
    return output.with_suffix(".convex")


def _by_scene(
    found: GraspsFile, root: GraspNetRoot, grasps: Path
) -> dict[SceneFiles, list[FrameResult]]:
    """Return the frames of each scene and camera.

    Raises:
        SymgraspError: there are no frames, or the dataset is not the one that they are from.
    """
    scenes: dict[SceneFiles, list[FrameResult]] = defaultdict(list)
    for result in found.results():
        try:
            frame = root.frame(result.name)
        except SymgraspError as error:
            raise FormatError(
                grasps, f"frame {result.name} is not in {root.root}", "give infer's dataset"
            ) from error
        scenes[root.scene(frame.scene_id, frame.camera)].append(result)
    if not scenes:
        raise SymgraspError(f"{grasps} holds no frames; run infer on the dataset first")
    return dict(scenes)


def _model_items(
    scenes: Iterable[SceneFiles], root: GraspNetRoot, output: Path, seed: int
) -> list[WorkItem]:
    """Return one item for every object of the scenes that has no convex pieces in the dataset."""
    reader = PiecesReader(root, pieces_folder(output))
    items = []
    for object_id in _object_ids(scenes):
        model, target = reader.source(object_id), reader.path(object_id)
        if model != target and model.is_file():
            stamp = make_stamp("simulate model", {}, seed=seed, inputs={"mesh": digest(model)})
            items.append(WorkItem(f"model {object_id:03d}", target, stamp, (model,)))
    return items


def _cut_model(item: WorkItem) -> None:
    (model,) = item.arguments
    pieces = convex_pieces(read_mesh(model), seed=item.stamp.seed)
    # The stamp first: pieces without one would be taken for those of another mesh.
    item.target.parent.mkdir(parents=True, exist_ok=True)
    write_sidecar(item.target, item.stamp)
    convex_file.write(item.target, pieces)


def _scene_items(
    scenes: Mapping[SceneFiles, list[FrameResult]], output: Path, stamp: Stamp
) -> list[WorkItem]:
    folder = trials_folder(output)
    named = {f"scene_{s.scene_id:04d}_{s.camera}": frames for s, frames in scenes.items()}
    return [
        WorkItem(name, folder / f"{name}.json", stamp, tuple(frames))
        for name, frames in sorted(named.items())
    ]


def _simulate_scene(
    dataset: Path, output: Path, config: SimulateConfig, item: WorkItem
) -> str | None:
    root = GraspNetRoot(dataset)
    pieces = PiecesReader(root, pieces_folder(output))
    simulator = FrameSimulator(root, pieces, load_gripper(config.gripper), config)
    frames = [simulator.run(result) for result in item.arguments]
    write_trials(item.target, frames, item.stamp)
    return None


def _drop_stale(items: Sequence[WorkItem], options: BatchOptions) -> None:
    """Remove what was made otherwise: without its `success.json` it is an interrupted run's."""
    for item in items:
        try:
            is_finished(item.target, item.stamp)
        except StaleOutputError:
            if not options.dry_run:
                item.target.unlink()


def _digests(scenes: Iterable[SceneFiles], root: GraspNetRoot, output: Path) -> dict[str, str]:
    """Return digests of what of the dataset, besides the scenes, decides the outcome."""
    reader = PiecesReader(root, pieces_folder(output))
    solids = [reader.source(i) for i in _object_ids(scenes)]
    models = "".join(f"{path} {digest(path)}" for path in solids if path.is_file())
    found = {"models": digest_text(models.replace(str(root.root), ""))}
    if (root.root / "symmetry").is_dir():
        found["symmetry"] = digest_folder(root.root / "symmetry", "*.json")
    return found


def _object_ids(scenes: Iterable[SceneFiles]) -> list[int]:
    return sorted({object_id for scene in scenes for object_id in scene.object_ids})


def _joined(first: StageReport, second: StageReport) -> StageReport:
    """Return what both did, as one stage."""
    return StageReport(
        second.stage,
        first.done + second.done,
        first.skipped + second.skipped,
        first.failed | second.failed,
        first.notes | second.notes,
        first.seconds + second.seconds,
    )


def _gripper_used(found: GraspsFile) -> str:
    return str(found.attrs["config"].get("gripper", DEFAULT_GRIPPER))
