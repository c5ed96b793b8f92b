"""Stage `finetune-detector`: training of Mask R-CNN on symmetric regions (Sec. III-D).

Reads   ROOT/scenes/scene_NNNN/CAMERA/{rgb,depth,label,annotations}, ROOT/models/
        ROOT/symmetry/NNN.json       regions, from annotate-symmetry
        or a COCO instance dataset of `export-coco`, with its own split
Writes  NAME.safetensors             the best weights so far by mask AP50 on unseen scenes
        NAME.frames/ROOT/*.h5        small frames with their region masks, made once
        NAME.checkpoint.safetensors  everything that `--resume` needs
        NAME.curves.png              losses and figures along the steps
        NAME.logs/                   TensorBoard scalars
        NAME.fault.safetensors       the batch, if a loss was not finite
"""

import json
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from pipelines.configs import FinetuneDetectorConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.dataset.held_back import refuse_held_back
from pipelines.dataset.scene_digests import digest_of_images, inputs_of_scenes
from pipelines.dataset.training import coco_instances, detector_frames
from pipelines.dataset.training.coco_instances import CocoFrame
from pipelines.dataset.training.region_frames import SCENE, FrameSets, split_frames
from pipelines.errors import ValueRangeError, counted
from pipelines.learning.detector import detector_training
from pipelines.learning.detector.detector_preparation import frames_of_coco, frames_of_scene
from pipelines.learning.detector.detector_start import starting_detector
from pipelines.learning.detector.detector_training import DetectorTraining
from pipelines.learning.loop.faults import read_fault
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import RunRequest, find_progress, refuse_own_start
from pipelines.learning.speed.processes import process_group
from pipelines.network.detection.detector import MODEL_NAME
from pipelines.network.weights_files import weights_metadata
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, drop_damaged, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import existing, real_path
from pipelines.storage.provenance import digest, digest_folder, digest_text, make_stamp

STAGE = "finetune-detector"


@one_run_at_a_time(STAGE, "output")
def run(
    roots: Sequence[Path],
    output: Path,
    config: FinetuneDetectorConfig,
    request: RunRequest,
    *,
    split: str | None = "train",
    camera: str | None = None,
    coco_weights: str | None = None,
    init: Path | None = None,
    options: BatchOptions | None = None,
) -> StageReport:
    """Prepare the roots' frames of `split` (None: all) next to `output`, then train on them.

    `coco_weights`: a file of torchvision's COCO weights, or `download`; for the resnet50 variant.
    `init`: weights of an earlier training to start from, for example the default weights.
    """
    with process_group(request.device) as (processes, device):
        started = time.monotonic()
        refuse_own_start(init, output)
        inputs = _inputs(roots, init, coco_weights)
        scenes = {root: scene_items(root, output, config, split, camera) for root in roots}
        stamps = [item.stamp.as_digest() for items in scenes.values() for item in items]
        inputs |= {"split": split or "all", "camera": camera or "all"}
        inputs["scenes"] = digest_text("\n".join(stamps))
        stamp = make_stamp(STAGE, config, seed=request.seed, inputs=inputs)
        earlier = find_progress(output, stamp, request)
        if earlier is not None and earlier.finished:
            return StageReport(STAGE, skipped=[output.name])
        # Before the frames are prepared, so that wrong weights are named at once.
        detector = starting_detector(config, request.seed, coco_weights, init)
        with processes.one_first(options or BatchOptions()) as batch:
            prepared = StageReport(STAGE)
            for root, items in scenes.items():
                prepared.add(prepare(root, items, config, batch), f"{_name(root)}/")
        if prepared.failed:
            return prepared
        ready = [*prepared.done, *prepared.skipped]
        frames = frames_of(roots, output, ready, config.val_fraction, request.seed)
        trainee = DetectorTraining(detector, frames, config, device, processes)
        metadata = weights_metadata(MODEL_NAME, config.detector)
        training = TrainingRun(trainee, config, request, output, stamp, metadata, processes)
        return training.report(started, resumes=earlier is not None)


def replay(fault: Path) -> dict[str, float]:
    """Return the loss terms of the batch in `NAME.fault.safetensors`, computed again."""
    return detector_training.replay(read_fault(fault, STAGE))


def _inputs(roots: Sequence[Path], init: Path | None, coco_weights: str | None) -> dict[str, str]:
    """Return the names and digests of the training's inputs.

    Raises:
        ValueRangeError: two roots have the same name, or none is given.
    """
    names = [_name(root) for root in roots]
    if len(names) != len(set(names)) or not names:
        raise ValueRangeError("roots", ", ".join(names) or "none", "folders of different names")
    inputs = {"root": ", ".join(names)}
    for root, name in zip(roots, names, strict=True):
        labels = "annotations" if coco_instances.is_coco(root) else "symmetry"
        key = labels if len(names) == 1 else f"{name}/{labels}"
        inputs[key] = digest_folder(root / labels, "*.json")
    if coco_weights is not None:
        path = Path(coco_weights)
        inputs["coco_weights"] = digest(path) if path.is_file() else coco_weights
    return inputs if init is None else inputs | {"init": digest(existing(init))}


def _name(root: Path) -> str:
    return real_path(root).name


def frames_of(
    roots: Sequence[Path], output: Path, scenes: Sequence[str], val_fraction: float, seed: int
) -> FrameSets:
    """Return the frames of `scenes`, each ROOT/SCENE: of each root some train, others validate.

    Scenes that an earlier run prepared next to `output`, with another split, are left out.

    Raises:
        ValueRangeError: a root has no frame to train on, or none to validate on.
    """
    sets = []
    for root in roots:
        folder = frames_folder(output, root)
        files = sorted(folder.parent / f"{each}.h5" for each in scenes)
        files = [path for path in files if path.parent == folder]
        count, given = detector_frames.count_frames, _given_split(root)
        sets.append(split_frames(files, count, val_fraction, seed, given))
    return FrameSets(
        [key for each in sets for key in each.train], [key for each in sets for key in each.val]
    )


def _given_split(root: Path) -> set[str] | None:
    """Return the validation scenes of a COCO dataset; None for other roots."""
    if not coco_instances.is_coco(root):
        return None
    return {frame.scene[:SCENE] for frame in coco_instances.read_coco_frames(root, "val")}


def frames_folder(output: Path, root: Path) -> Path:
    """Return the folder of the prepared frames of `root` for the run that writes `output`."""
    return output.with_name(f"{output.stem}.frames") / _name(root)


def prepare(
    root: Path, items: Sequence[WorkItem], config: FinetuneDetectorConfig, options: BatchOptions
) -> StageReport:
    """Write a file of small frames and their regions for each scene of `root` that has none yet."""
    step = partial(prepare_scene, root=GraspNetRoot(root), config=config)
    drop_damaged(items, options)
    return run_batch(STAGE, items, step, options)


def scene_items(
    root: Path,
    output: Path,
    config: FinetuneDetectorConfig,
    split: str | None = None,
    camera: str | None = None,
) -> list[WorkItem]:
    """Return the work items of a root or of a COCO dataset, one per scene and camera."""
    folder = frames_folder(output, root)
    if coco_instances.is_coco(root):
        return _coco_items(root, folder, config)
    dataset = GraspNetRoot.finished(root)
    refuse_held_back(dataset)
    scenes = dataset.chosen_scenes(camera, split)
    return [
        _item(folder, scene.name, config, inputs, scene)
        for scene, inputs in zip(scenes, inputs_of_scenes(dataset, scenes), strict=True)
    ]


def _coco_items(root: Path, folder: Path, config: FinetuneDetectorConfig) -> list[WorkItem]:
    """Return the scenes of a COCO instance dataset that also has depth and cameras."""
    scenes: dict[str, list[CocoFrame]] = {}
    for split in coco_instances.COCO_SPLITS:
        for frame in coco_instances.read_coco_frames(root, split):
            scenes.setdefault(frame.scene, []).append(frame)
    items = []
    for name, frames in sorted(scenes.items()):
        shown = json.dumps([frame.annotations for frame in frames], sort_keys=True)
        pictures = digest_of_images(
            frame.files.path(kind) for frame in frames for kind in ("rgb", "depth")
        )
        inputs = {"annotations": digest_text(shown), "frames": pictures}
        items.append(_item(folder, name, config, inputs, frames))
    return items


def _item(
    folder: Path,
    name: str,
    config: FinetuneDetectorConfig,
    inputs: Mapping[str, str],
    source: SceneFiles | list[CocoFrame],
) -> WorkItem:
    settings = {
        "size": [config.detector.min_size, config.detector.max_size],
        "min_pixels": config.min_pixels,
        "frame_stride": config.frame_stride,
    }
    stamp = make_stamp(STAGE, settings, inputs=inputs)
    return WorkItem(name, folder / f"{name}.h5", stamp, (source,))


def prepare_scene(item: WorkItem, root: GraspNetRoot, config: FinetuneDetectorConfig) -> str:
    """Prepare one scene; `item.arguments` are its files, or its COCO frames. Return the count."""
    (source,) = item.arguments
    if isinstance(source, SceneFiles):
        frames = frames_of_scene(source, root, config)
    else:
        frames = frames_of_coco(source, root, config)
    detector_frames.write(item.target, frames, item.stamp)
    return counted(len(frames), "frame")
