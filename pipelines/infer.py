"""Stage `infer`: RGB-D frames in, ranked grasps out (Sec. III-E, III-F).

Reads   a folder of RGB-D frames in any layout that `formats/frames.py` knows; weights
Writes  one `grasps.h5` for all frames; with overlays, a picture a frame

Several frames are worked on side by side. Each finished one is a shard beside the output until all
are done, so a run that was killed goes on where it stopped, and ends with the same bytes; the
output is put together from the shards, so memory does not grow with the number of frames. A frame
that cannot be read is listed as failed and does not stop the others; a frame with nothing to grasp
is `empty`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from pipelines.batch import BatchOptions, StageReport, run_batch
from pipelines.configs import InferConfig
from pipelines.formats import grasps_file
from pipelines.formats.camera_files import CameraFile
from pipelines.formats.frames import FrameSource
from pipelines.formats.grasps_stream import read_frames
from pipelines.formats.overlays import write_overlay
from pipelines.formats.provenance import is_finished
from pipelines.inference.work import (
    STAGE,
    InferPaths,
    Settings,
    Work,
    check_names,
    drop_stale_shards,
    infer_frame,
    overlay_path,
    side_by_side,
)
<<<<<<< HEAD

__all__ = ["InferPaths", "infer_frame", "overlay_path", "run"]
=======
from pipelines.formats.registration import oddities
from pipelines.formats.workspace_files import read_workspace_mask
from pipelines.grasping.limits import check_limits
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.regions import SOURCES

STAGE = "infer"
METHODS = ("network", "planar", "random")
MAX_THREADS = 4


@dataclass(frozen=True)
class InferPaths:
    """Where `infer` reads from and writes to; None where something is not wanted.

    Attributes:
        frames: folder of RGB-D frames.
        output: `grasps.h5`.
        overlays: folder for pictures.
        masks: folder of the user's instance masks, instead of found regions.
        workspace: picture, black where nothing may be grasped.
        detector: weights of the region detector.
        network: weights of the grasp network.
    """

    frames: Path
    output: Path
    overlays: Path | None = None
    masks: Path | None = None
    workspace: Path | None = None
    detector: Path = models.DETECTOR_WEIGHTS
    network: Path = models.NETWORK_WEIGHTS

    def with_weights(self, detector: Path | None, network: Path | None) -> "InferPaths":
        """Return the same paths with other weights; None keeps what is there."""
        return replace(self, detector=detector or self.detector, network=network or self.network)


@dataclass(frozen=True)
class _Settings:
    """What every frame of a run is treated with; picklable."""

    paths: InferPaths
    config: InferConfig
    seed: int
    device: str
    timings: bool

    @property
    def uses_detector(self) -> bool:
        return self.config.regions in ("auto", "detector") and self.paths.masks is None

    @property
    def uses_network(self) -> bool:
        return self.config.method == "network"

    def weights(self) -> dict[str, str]:
        """Return the digests of the weights that are used."""
        wanted = {}
        if self.uses_detector:
            path = models.existing_weights(self.paths.detector, "symgrasp finetune-detector")
            wanted["detector"] = digest(path)
        if self.uses_network:
            path = models.existing_weights(self.paths.network, "symgrasp train")
            wanted["network"] = digest(path)
        return wanted

    def other_inputs(self) -> dict[str, str]:
        """Return the digests of the gripper, the user's masks and the workspace."""
        others = {"gripper": gripper_digest(self.config.gripper)}
        if self.paths.masks is not None:
            pictures = sorted(self.paths.masks.rglob("*.png"))
            others["masks"] = digest_text("".join(f"{p.name} {digest(p)}" for p in pictures))
        if self.paths.workspace is not None:
            others["workspace"] = digest(self.paths.workspace)
        return others

    def one_core(self) -> AbstractContextManager[None]:
        """Let networks, where there are some, use one core for each frame."""
        uses = self.uses_detector or self.uses_network
        return models.one_thread_each() if uses else nullcontext()

    def planner(self) -> Planner:
        """Return the planner, its networks loaded once a process."""
        return Planner(
            self.config,
            load_gripper(self.config.gripper),
            models.detector(self.paths.detector, self.device) if self.uses_detector else None,
            models.predictor(self.paths.network, self.device) if self.uses_network else None,
        )
>>>>>>> 0f7a9d1 (infer: the way in is free, grasps differ, --workspace, --approach-cone, --top; preset grippers drawn)


def run(
    paths: InferPaths,
    config: InferConfig,
    options: BatchOptions,
    *,
    camera: CameraFile | None = None,
    depth_units_per_metre: float | None = None,
    seed: int = 0,
    device: str = "auto",
    timings: bool = False,
) -> StageReport:
    """Find grasps in all frames of `paths.frames`.

    Args:
        paths: what to read and write.
        config: how.
        options: workers, overwrite, dry run.
        camera: intrinsics of all frames, instead of the files beside them.
        depth_units_per_metre: unit of the depth files, instead of what the files say.
        seed: of everything that is drawn at random.
        device: for the networks.
        timings: write the seconds a frame took; the file then differs from run to run.

    Raises:
        SymgraspError: no frames, unknown names, weights missing, or the output was made otherwise.
    """
    check_names(config)
    settings = Settings(paths, config, seed, device, timings)
    work = Work(settings, camera, depth_units_per_metre)
    sources = work.find()
    items = work.items(sources)
    if is_finished(paths.output, work.whole_stamp(items), overwrite=options.overwrite):
        if not options.dry_run:
            grasps_file.remove_shards(paths.output)  # of frames that were followed
        return _finished_report(paths, sources)
    if not options.dry_run:
        drop_stale_shards(items)
    resumed = side_by_side(replace(options, overwrite=False))  # shards are of this very run
    with settings.one_core():
        report = run_batch(STAGE, items, partial(infer_frame, settings=settings), resumed)
    if not options.dry_run:
        work.put_together(items, report.failed)
        grasps_file.remove_shards(paths.output)
    return report


<<<<<<< HEAD
=======
def infer_frame(item: WorkItem, settings: _Settings) -> str | None:
    """Write the shard of one frame; return a note where it is empty."""
    with settings.one_core():
        return _infer_frame(item, settings)


def _infer_frame(item: WorkItem, settings: _Settings) -> str | None:
    (source,) = item.arguments
    frame = source.read()
    folder = settings.paths.masks
    masks = None if folder is None else read_masks(folder, source.name)
    if masks is not None and masks.shape != frame.depth.shape:
        raise ValueRangeError(
            f"size of the masks of {source.name}", masks.shape, f"{frame.depth.shape}"
        )
    path = settings.paths.workspace
    workspace = None if path is None else read_workspace_mask(path, frame.depth.shape)
    rng = np.random.default_rng(settings.seed)
    result = settings.planner().plan(frame, rng, masks, workspace)
    result = replace(
        result, name=source.name, seconds=result.seconds if settings.timings else np.nan
    )
    if settings.paths.overlays is not None:
        write_overlay(overlay_path(settings.paths.overlays, source.name), frame, result)
    grasps_file.write_shard(item.target, result, item.stamp)
    return "; ".join(filter(None, (*oddities(frame), result.message))) or None


def overlay_path(folder: Path, frame_name: str) -> Path:
    """Return where the picture of a frame goes."""
    return folder / f"{frame_name}.png"


def _check_names(config: InferConfig) -> None:
    for kind, name, known in (
        ("regions", config.regions, SOURCES),
        ("method", config.method, METHODS),
    ):
        if name not in known:
            raise UnknownNameError(kind, name, known)
    check_limits(config.limits)
    load_gripper(config.gripper)


def _item(
    source: FrameSource, settings: _Settings, common: dict[str, str], digests: dict[Path, str]
) -> WorkItem:
    # Colour and depth may have one name, in two folders.
    inputs = common | {f"{i} {path.name}": digests[path] for i, path in enumerate(source.files)}
    stamp = make_stamp(STAGE, settings.config, seed=settings.seed, inputs=inputs)
    target = grasps_file.shard_path(settings.paths.output, source.name)
    return WorkItem(source.name, target, stamp, (source,))


def _whole_stamp(items: Sequence[WorkItem], settings: _Settings, common: dict[str, str]) -> Stamp:
    frames = digest_text("\n".join(f"{item.name} {item.stamp.as_text()}" for item in items))
    inputs = common | {"frames": frames}
    return make_stamp(STAGE, settings.config, seed=settings.seed, inputs=inputs)


def _drop_stale_shards(items: Sequence[WorkItem]) -> None:
    """Remove shards that a killed run with other settings left: nobody waits for them."""
    for item in items:
        if item.target.exists() and read_stamp(item.target) != item.stamp.as_json():
            item.target.unlink()


def _side_by_side(options: BatchOptions) -> BatchOptions:
    """Return `options` with a thread a core instead of one worker: networks and numpy share well.

    More than a few threads would wait for Python's lock; `--workers` are processes.
    """
    if options.workers > 1:
        return options
    return replace(options, workers=min(cpu_count(), MAX_THREADS), backend="threading")


def _result(item: WorkItem, report: StageReport) -> FrameResult | Path:
    """Return what to put into the output: the frame's shard, or that it failed."""
    if item.name in report.failed:
        return FrameResult(item.name, "failed", report.failed[item.name], seconds=np.nan)
    return item.target


>>>>>>> 0f7a9d1 (infer: the way in is free, grasps differ, --workspace, --approach-cone, --top; preset grippers drawn)
def _finished_report(paths: InferPaths, sources: Sequence[FrameSource]) -> StageReport:
    """Return what the finished output says; pictures that are missing are drawn from it."""
    report = StageReport(STAGE)
    results = read_frames(paths.output, range(len(sources)))
    for source, result in zip(sources, results, strict=True):
        if result.status == "failed":
            report.failed[result.name] = result.message
            continue
        report.skipped.append(result.name)
        if paths.overlays is not None and not overlay_path(paths.overlays, result.name).exists():
            write_overlay(overlay_path(paths.overlays, result.name), source.read(), result)
    return report
