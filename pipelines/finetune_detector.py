"""finetune-detector: Mask R-CNN on masks of symmetric regions (Sec. III-D).

Reads   ROOT/scenes/scene_NNNN/CAMERA/{rgb,depth,label,annotations}
        ROOT/symmetry/NNN.json       regions, from annotate-symmetry
        or a COCO instance dataset of `export-coco`, with its own split
Writes  NAME.safetensors             the best weights so far by mask AP50 on unseen scenes
        NAME.frames/*.h5             small frames with their region masks, made once
        NAME.checkpoint.safetensors  everything that `--resume` needs
        NAME.logs/                   TensorBoard scalars
"""

import logging
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torchvision.models.detection import MaskRCNN

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import FinetuneDetectorConfig
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.formats import coco_instances, detector_frames
from pipelines.formats.coco_instances import CocoFrame
from pipelines.formats.detector_frames import DetectorFrame
from pipelines.formats.graspnet import GraspNetRoot, SceneFiles
from pipelines.formats.provenance import make_stamp
from pipelines.formats.region_frames import (
    MOST_REGIONS,
    held_out_scenes,
    read_region_frame,
)
from pipelines.formats.rgbd import Frame
from pipelines.formats.torch_weights import read_torch_weights
from pipelines.geometry.depth_channels import find_plane, shrink
from pipelines.learning.detector_training import DetectorTraining, FrameSets
from pipelines.learning.loop import LoopOptions, TrainingRun
from pipelines.learning.runs import RunRequest, describe, find_progress
from pipelines.network.detector import MODEL_NAME
from pipelines.network.devices import find_device
from pipelines.network.mask_rcnn import adopt_coco, build_detector
from pipelines.network.weights_files import weights_metadata

STAGE = "finetune-detector"
SCENE = len("scene_0000")

log = logging.getLogger(__name__)


def run(
    root: Path,
    output: Path,
    config: FinetuneDetectorConfig,
    request: RunRequest,
    *,
    split: str | None = "train",
    camera: str | None = None,
    coco_weights: str | None = None,
    options: BatchOptions | None = None,
) -> StageReport:
    """Prepare the frames of `split` (None: all) beside `output`, then train on them.

    `coco_weights`: a file of torchvision's COCO weights, or `download`; for the resnet50 variant.
    """
    started, report = time.monotonic(), StageReport(STAGE)
    device = find_device(request.device)
    stamp = make_stamp(STAGE, config, seed=request.seed, inputs={"root": root.name})
    earlier = find_progress(output, stamp, request)
    if earlier is not None and earlier.finished:
        report.skipped.append(output.name)
        return report
    options = options or BatchOptions()
    held_out: set[str] | None = None
    if coco_instances.is_coco(root):
        prepared = prepare_coco(root, output, config, options)
        held_out = {frame.scene[:SCENE] for frame in coco_instances.read_frames(root, "val")}
    else:
        prepared = prepare(GraspNetRoot(root), output, config, split, camera, options)
    if prepared.failed:
        return prepared
    files = sorted(frames_folder(output).glob("*.h5"))
    frames = split_frames(files, config, request.seed, held_out)
    trainee = DetectorTraining(build(config, coco_weights, request.seed), frames, config, device)
    metadata = weights_metadata(MODEL_NAME, config.detector)
    training = TrainingRun(trainee, loop_options(config, request), output, stamp, metadata)
    if earlier is not None:
        training.resume()
    progress = training.run()
    report.done.append(output.name)
    report.notes[output.name] = describe(progress)
    report.seconds = time.monotonic() - started
    return report


def frames_folder(output: Path) -> Path:
    """Return where the prepared frames of the run that writes `output` lie."""
    return output.with_name(f"{output.stem}.frames")


def prepare(
    root: GraspNetRoot,
    output: Path,
    config: FinetuneDetectorConfig,
    split: str | None,
    camera: str | None,
    options: BatchOptions,
) -> StageReport:
    """Write one file of small frames with their regions for each scene that has none yet."""
    scenes = root.scenes(camera, split)
    if not scenes:
        raise SymgraspError(
            f"{root.root} holds no {split or 'any'} scene; name another --split or --camera"
        )
    items = [
        _item(output, f"scene_{scene.scene_id:04d}_{scene.camera}", config, scene)
        for scene in scenes
    ]
    return run_batch(STAGE, items, partial(prepare_scene, root=root, config=config), options)


def prepare_coco(
    folder: Path, output: Path, config: FinetuneDetectorConfig, options: BatchOptions
) -> StageReport:
    """Write the same files from a COCO instance dataset that has depth and cameras beside it."""
    scenes: dict[str, list[CocoFrame]] = {}
    for split in coco_instances.SPLITS:
        for frame in coco_instances.read_frames(folder, split):
            scenes.setdefault(frame.scene, []).append(frame)
    items = [_item(output, name, config, frames) for name, frames in sorted(scenes.items())]
    root = GraspNetRoot(folder)
    return run_batch(STAGE, items, partial(prepare_coco_scene, root=root, config=config), options)


def _item(
    output: Path, name: str, config: FinetuneDetectorConfig, source: SceneFiles | list[CocoFrame]
) -> WorkItem:
    settings = {
        "size": [config.detector.min_size, config.detector.max_size],
        "min_pixels": config.min_pixels,
        "frame_stride": config.frame_stride,
    }
    target = frames_folder(output) / f"{name}.h5"
    return WorkItem(name, target, make_stamp(STAGE, settings), (source,))


def prepare_scene(item: WorkItem, root: GraspNetRoot, config: FinetuneDetectorConfig) -> str:
    """Prepare one scene; `item.arguments` are its files. Return the count of frames."""
    scene: SceneFiles = item.arguments[0]
    frames = []
    for files in scene.frames()[:: config.frame_stride]:
        shown = read_region_frame(root, files, config.min_pixels)
        masks = [region.mask for region in shown.regions]
        frames.append(prepare_frame(shown.frame, masks, config))
    detector_frames.write(item.target, frames, item.stamp)
    return f"{len(frames)} frames"


def prepare_coco_scene(item: WorkItem, root: GraspNetRoot, config: FinetuneDetectorConfig) -> str:
    """Prepare one scene of a COCO dataset; `item.arguments` are its frames."""
    listed: list[CocoFrame] = item.arguments[0]
    frames = []
    for each in listed[:: config.frame_stride]:
        masks = [mask for mask in each.masks() if mask.sum() >= config.min_pixels]
        frames.append(prepare_frame(root.read_frame(each.files), masks[:MOST_REGIONS], config))
    detector_frames.write(item.target, frames, item.stamp)
    return f"{len(frames)} frames"


def prepare_frame(
    frame: Frame, masks: Sequence[NDArray[np.bool_]], config: FinetuneDetectorConfig
) -> DetectorFrame:
    """Return a frame at the detector's size with its regions, numbered from 1."""
    detector = config.detector
    small = shrink(frame.color, frame.depth, frame.intrinsics, detector.min_size, detector.max_size)
    regions = np.zeros((frame.intrinsics.height, frame.intrinsics.width), np.uint8)
    for number, mask in enumerate(masks, start=1):
        regions[mask] = number
    rows = np.floor((np.arange(small.depth.shape[0]) + 0.5) * regions.shape[0] / len(small.depth))
    columns = np.floor(
        (np.arange(small.depth.shape[1]) + 0.5) * regions.shape[1] / small.depth.shape[1]
    )
    picked = regions[np.ix_(rows.astype(int), columns.astype(int))]
    return DetectorFrame(small, find_plane(small), picked)


def split_frames(
    files: list[Path],
    config: FinetuneDetectorConfig,
    seed: int,
    held_out: set[str] | None = None,
) -> FrameSets:
    """Return the frames of most scenes to train on and of the others to validate on.

    `held_out`: the scenes to validate on, where they are given.

    Raises:
        ValueRangeError: there is only one scene.
    """
    scenes = {path.stem[:SCENE] for path in files}
    if len(scenes) < 2:
        raise ValueRangeError("number of scenes", len(scenes), "at least 2, one to validate on")
    if held_out is None:
        held_out = held_out_scenes(sorted(scenes), config.val_fraction, seed)
    keys = [(path, row) for path in files for row in range(detector_frames.count(path))]
    is_val = [path.stem[:SCENE] in held_out for path, _ in keys]
    return FrameSets(
        [key for key, val in zip(keys, is_val, strict=True) if not val],
        [key for key, val in zip(keys, is_val, strict=True) if val],
    )


def build(config: FinetuneDetectorConfig, coco_weights: str | None, seed: int) -> MaskRCNN:
    """Return the detector to start from, with COCO's weights where they are asked for.

    Raises:
        ValueRangeError: COCO weights are asked for a variant that has none.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)  # layers are initialised from torch's own generator
        model = build_detector(config.detector)
    if coco_weights is None:
        return model
    if config.detector.variant != "resnet50":
        raise ValueRangeError("--coco-weights", coco_weights, "left out unless --variant resnet50")
    fresh = adopt_coco(model, read_coco(coco_weights))
    log.info("%d tensors start anew, the others from COCO", len(fresh))
    return model


def read_coco(source: str) -> dict[str, torch.Tensor]:
    """Return torchvision's COCO weights from a file, or from its hub for `download`."""
    if source != "download":
        return read_torch_weights(Path(source))
    from torchvision.models.detection import MaskRCNN_ResNet50_FPN_Weights  # noqa: PLC0415

    weights = MaskRCNN_ResNet50_FPN_Weights.COCO_V1
    log.warning("downloading COCO weights from %s", weights.url)
    try:
        return dict(weights.get_state_dict(progress=False, check_hash=True))
    except OSError as error:
        raise SymgraspError(
            f"{weights.url} cannot be reached ({error}); give --coco-weights a file of it"
        ) from error


def loop_options(config: FinetuneDetectorConfig, request: RunRequest) -> LoopOptions:
    """Return the engine's options: what the config says of steps, the request of this run."""
    return LoopOptions(
        epochs=config.epochs,
        learning_rate=config.learning_rate,
        decay=config.decay,
        decay_epochs=config.decay_epochs,
        ema_decay=config.ema_decay,
        seed=request.seed,
        threads=request.threads,
        time_limit=request.time_limit,
    )
