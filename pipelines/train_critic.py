"""Stage `train-critic`: critics of axes, planes and grasps, fitted to candidates with known truth.

Reads   ROOT/{scenes,models,symmetry}   frames to train on
        HELD/...                        the same, with objects that no network was trained on
        weights to find candidates with: detector, network, earlier critics
Writes  NAME.safetensors                weights with the name of every feature, calibrated on HELD
        NAME.rows/ROOT/*.h5             candidates of each scene with their truth, collected once
        NAME.checkpoint.safetensors     everything that `--resume` needs
        NAME.curves.png, NAME.logs/     loss and figures along the steps
        NAME.fault.safetensors          the batch, if a loss was not finite
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.configs import EvaluateConfig, InferConfig, TrainCriticConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.held_back import refuse_held_back
from pipelines.dataset.scene_digests import inputs_of_scenes
from pipelines.dataset.training.region_frames import strided_frames
from pipelines.errors import ValueRangeError, counted
from pipelines.evaluation.truth import TruthReader
from pipelines.grasping.critics import critic_files
from pipelines.inference import models
from pipelines.learning.critics import critic_rows, critic_training
from pipelines.learning.critics.collecting import Collector, ModelPaths
from pipelines.learning.critics.critic_rows import CriticRows
from pipelines.learning.critics.critic_training import CriticTraining
from pipelines.learning.critics.kinds import CRITIC_KINDS, CriticKind
from pipelines.learning.loop.faults import read_fault
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import RunRequest, describe, find_progress, refuse_own_start
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, drop_damaged, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import real_path
from pipelines.storage.provenance import (
    MISSING,
    Stamp,
    digest,
    digest_if_there,
    digest_text,
    make_stamp,
    refuse_other_suffix,
)

log = logging.getLogger(__name__)

STAGE = "train-critic"


@one_run_at_a_time(STAGE, "output")
def run(
    kind: CriticKind,
    roots: Sequence[Path],
    output: Path,
    config: TrainCriticConfig,
    request: RunRequest,
    *,
    held_out: Sequence[Path] = (),
    init: Path | None = None,
    paths: ModelPaths | None = None,
    options: BatchOptions | None = None,
) -> StageReport:
    """Collect candidates of all roots next to `output`, then fit a critic of `kind` to them.

    `held_out`: roots that networks are validated and calibrated on. `init`: weights of an earlier
    critic to start from.
    """
    refuse_other_suffix(output, ".safetensors")
    refuse_own_start(init, output)
    _check_roots(roots, held_out)
    start = None if init is None else critic_files.read_point_critic(init, kind.model)
    started, paths = time.monotonic(), paths or ModelPaths()
    _warn_of_unused_weights(kind, paths)
    weights = weights_used(kind, paths, config.infer)
    items = {
        root: row_items(root, output, kind, config, request.seed, weights)
        for root in (*roots, *held_out)
    }
    stamp = _stamp(kind, items, held_out, init, config, request.seed)
    earlier = find_progress(output, stamp, request)
    if earlier is not None and earlier.finished:
        return StageReport(STAGE, skipped=[output.name])
    _warn_of_shared_objects(roots, held_out, items)
    step = partial(collect_scene, kind=kind, paths=paths, config=config, seed=request.seed)
    scenes = [each for group in items.values() for each in group]
    options = options or BatchOptions()
    drop_damaged(scenes, options)
    report = run_batch(STAGE, scenes, step, options)
    if report.failed:
        return report
    rows, held = _read(roots, items), _read(held_out, items)
    trainee = CriticTraining(kind, rows, held, config, request.seed, start=start)
    metadata = critic_files.metadata_of(kind.model)
    training = TrainingRun(trainee, config, request, output, stamp, metadata)
    note = _trained(training, trainee, resumes=earlier is not None)
    return StageReport(
        STAGE, [output.name], notes={output.name: note}, seconds=time.monotonic() - started
    )


def replay(fault: Path) -> dict[str, float]:
    """Return the loss terms of the batch in `NAME.fault.safetensors`, computed again."""
    kept = read_fault(fault, STAGE)
    return critic_training.replay(kept, CRITIC_KINDS[kept.settings["kind"]])


def _check_roots(roots: Sequence[Path], held_out: Sequence[Path]) -> None:
    """Raise SymgraspError unless the roots differ, some are held out, and all may be used."""
    names = [_name(root) for root in (*roots, *held_out)]
    if len(names) != len(set(names)):
        raise ValueRangeError("roots", ", ".join(names), "folders of different names")
    if not held_out:
        needed = "a dataset of objects that no network was trained on"
        raise ValueRangeError("--calibrate", "not given", needed)
    for root in (*roots, *held_out):
        refuse_held_back(GraspNetRoot(root))


def _name(root: Path) -> str:
    return real_path(root).name


def _warn_of_unused_weights(kind: CriticKind, paths: ModelPaths) -> None:
    """Warn of each file of weights that is given and that a critic of `kind` does not need."""
    for name, path in vars(paths).items():
        if name not in kind.needs and path != getattr(ModelPaths, name):
            log.warning("%s is not used to train a critic of %s", path, kind.name)


def _warn_of_shared_objects(
    roots: Sequence[Path], held_out: Sequence[Path], items: Mapping[Path, Sequence[WorkItem]]
) -> None:
    """Warn of datasets to calibrate on that have objects of the datasets to train on."""
    learned = {mesh for root in roots for mesh in _meshes(items[root])}
    for root in held_out:
        own = _meshes(items[root])
        if shared := len(own & learned):
            log.warning(
                "objects of %s are trained on too (%d of %d): the calibration is too confident; "
                "give a --calibrate with other objects",
                root,
                shared,
                len(own),
            )


def _meshes(items: Sequence[WorkItem]) -> set[str]:
    """Return the digests of the meshes of all objects in scenes."""
    inputs = [pair for item in items for pair in item.stamp.inputs.items()]
    return {found for name, found in inputs if "/" in name and found != MISSING}


def weights_used(kind: CriticKind, paths: ModelPaths, config: InferConfig) -> dict[str, str]:
    """Return the digests of the weights that candidates of `kind` are found with.

    All weights in use are loaded, so that a wrong file is named once and not by every scene.

    Raises:
        MissingInputError: one of the files does not exist.
        FormatError: one of the files holds weights of another model.
    """
    load: dict[str, Callable[[Path], object]] = {
        "network": lambda path: models.predictor(path, "cpu", config.mirrored),
        "axis_critic": models.axis_critic,
        "plane_critic": lambda path: models.symmetry_critics(paths.axis_critic, path),
    }
    if config.regions != "geometric":
        load["detector"] = lambda path: models.detector(path, "cpu")
    for name in (name for name in kind.needs if name in load):
        load[name](getattr(paths, name))
    return {name: digest_if_there(getattr(paths, name)) for name in kind.needs}


def row_items(
    root: Path,
    output: Path,
    kind: CriticKind,
    config: TrainCriticConfig,
    seed: int,
    weights: Mapping[str, str],
) -> list[WorkItem]:
    """Return the work items that collect candidates next to `output`, one per scene of `root`."""
    dataset = GraspNetRoot.finished(root)
    folder = output.with_name(f"{output.stem}.rows") / _name(root)
    scenes = dataset.chosen_scenes(None, None)
    settings = {
        "kind": kind.name,
        "features": vars(kind.features),
        "frame_stride": config.frame_stride,
        "max_grasps": config.max_grasps if kind.chooses else 0,
        "infer": asdict(config.infer),
        "evaluate": asdict(config.evaluate),
    }
    items = []
    for scene, inputs in zip(scenes, inputs_of_scenes(dataset, scenes), strict=True):
        name, around = f"{_name(root)}/{scene.name}", scene.surroundings_path
        found = {**weights, **inputs}
        if kind.chooses and around.is_file():  # grasps that touch them are bad
            found[around.name] = digest(around)
        stamp = make_stamp(STAGE, settings, seed=seed, inputs=found)
        items.append(WorkItem(name, folder / f"{scene.name}.h5", stamp, (root, scene)))
    return items


def collect_scene(
    item: WorkItem, kind: CriticKind, paths: ModelPaths, config: TrainCriticConfig, seed: int
) -> str:
    """Write the candidates of one scene; `item.arguments` are its root and files."""
    root, scene = item.arguments
    collector = Collector(_reader(root, config.evaluate), paths, config, seed)
    parts = [CriticRows.none(kind.num_points, kind.features)]
    with models.one_thread_each():
        for files in strided_frames(scene, config.frame_stride):
            rng = np.random.default_rng([seed, files.scene_id, files.frame_id])
            parts += collector.rows(kind, files, rng)
    rows = CriticRows.joined(parts)
    critic_rows.write(item.target, rows, item.stamp)
    return counted(len(rows), "candidate")


@lru_cache(maxsize=1)
def _reader(root: Path, config: EvaluateConfig) -> TruthReader:
    """Return the reader of the truth of `root`, which caches the objects."""
    return TruthReader(GraspNetRoot(root), config)


def _read(roots: Sequence[Path], items: Mapping[Path, Sequence[WorkItem]]) -> CriticRows:
    """Return the candidates with known truth of all scenes of `roots`."""
    return critic_rows.read_known([item.target for root in roots for item in items[root]])


def _stamp(
    kind: CriticKind,
    items: Mapping[Path, Sequence[WorkItem]],
    held_out: Sequence[Path],
    init: Path | None,
    config: TrainCriticConfig,
    seed: int,
) -> Stamp:
    settings: dict[str, Any] = {"kind": kind.name, **asdict(config)}
    inputs = {
        f"{'held out' if root in held_out else 'root'} {_name(root)}": digest_text(
            "\n".join(item.stamp.as_digest() for item in group)
        )
        for root, group in items.items()
    }
    started_from = {} if init is None else {"init": digest(init)}
    return make_stamp(STAGE, settings, seed=seed, inputs=inputs | started_from)


def _trained(training: TrainingRun, trainee: CriticTraining, *, resumes: bool) -> str:
    """Train a network, calibrated on the held-out roots; return a note."""
    if resumes:
        training.resume()
    learned, held = counted(len(trainee.rows), "candidate"), len(trainee.held)
    return f"{learned} learned from, {held} calibrated on; {describe(training.run())}"
