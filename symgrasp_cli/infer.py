"""`symgrasp infer`."""

import json
import math
import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.configs import InferConfig, LimitsConfig
from pipelines.configs.inference import TRAINED_METHODS
from pipelines.configs.settings import changed
from pipelines.configs.stages import InferSettings, as_config
from pipelines.errors import counted, printable
from symgrasp_cli.arguments import Batch, CameraAndUnits, FromOptions, SymmetryModels
from symgrasp_cli.options import (
    CameraName,
    DatasetSplit,
    Device,
    FrameFolder,
    GraspCriticWeights,
    Seed,
    Workers,
)
from symgrasp_cli.report import conclude, report_style
from symgrasp_cli.settings import named_as, with_settings

if TYPE_CHECKING:
    from pipelines.dataset.chosen_frames import ChosenFrames
    from pipelines.inference.runs.following import FrameOutcome
    from pipelines.runtime.batch import BatchOptions, StageReport

DEFAULT_FRAME = LimitsConfig.box_frame
HDF5_SUFFIXES = ("", ".h5", ".hdf5")


def _weights(
    models: SymmetryModels,
    grasp_critic: GraspCriticWeights = None,
    weights: Annotated[
        Path | None,
        typer.Option(exists=True, help="Weights of a compared method, from train-baseline."),
    ] = None,
) -> dict[str, Path | None]:
    """Return the weights that the user names, by model."""
    return {**models, "grasp_critic": grasp_critic, "peer": weights}


def _batch(options: Batch, workers: Workers = None) -> "BatchOptions":
    """Return the options of the batch; `infer` chooses the workers unless the user does."""
    from pipelines.runtime.batch import CHOSEN

    if workers is not None:
        return options
    return replace(options, workers=CHOSEN, most_chosen=options.workers)


def _choice(
    split: DatasetSplit = "all",
    camera: CameraName = None,
    frame_stride: Annotated[
        int, typer.Option(min=1, metavar="N", help="Every N-th frame of each folder.")
    ] = 1,
) -> "ChosenFrames":
    """Return the choice of frames."""
    from pipelines.dataset.chosen_frames import ChosenFrames

    return ChosenFrames(split, camera, frame_stride)


def _settings_of_workspace(workspace: str) -> tuple[str, ...]:
    """Return the setting that `--workspace` changes: none if it names a mask."""
    from pipelines.frames.workspace_files import box_of_text

    return ("limits.box",) if box_of_text(workspace) else ()


InferChoice = Annotated["ChosenFrames", FromOptions(_choice)]
InferWeights = Annotated[dict[str, Path | None], FromOptions(_weights)]
InferBatch = Annotated["BatchOptions", FromOptions(_batch)]


@with_settings(
    "infer",
    {
        **named_as("regions", "gripper", "method", "mirrored"),
        "--grounding/--no-grounding": "selection.symmetry.is_fitted",
        "--rank-by": "selection.ranking.by",
        "--top": "max_grasps_per_region",
        "--min-score": "min_score",
        "--workspace-frame": "limits.box_frame",
        **named_as("limits.approach_cone", "limits.approach_direction", "limits.approach_frame"),
        "--watch-timeout": "watch.timeout",
    },
    composite={"--workspace": _settings_of_workspace},
)
def infer(
    config: InferSettings,
    frames: FrameFolder,
    *,
    out: Annotated[Path, typer.Option(help="File of grasps to write.")] = Path("grasps.h5"),
    overlays: Annotated[
        Path | None, typer.Option(help="Folder for a picture of every frame's grasps.")
    ] = None,
    masks: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            file_okay=False,
            help="Folder of instance masks, NAME_label.png, to use as regions.",
        ),
    ] = None,
    workspace: Annotated[
        str | None,
        typer.Option(
            help="Space that grasps must be in: a mask picture, black outside, of the depth's "
            "size, or a box x0,y0,z0,x1,y1,z1 in metres."
        ),
    ] = None,
    choice: InferChoice,
    stated: CameraAndUnits,
    weights: InferWeights,
    timings: Annotated[
        bool,
        typer.Option("--timings", help="Write the seconds of each frame; each run's file differs."),
    ] = False,
    watch: Annotated[
        bool,
        typer.Option("--watch", help="Follow a folder that a camera writes into, until Ctrl-C."),
    ] = False,
    device: Device = "auto",
    options: InferBatch,
    seed: Seed = 0,
) -> None:
    """Find ranked grasps in RGB-D frames."""
    from pipelines import infer as stage
    from pipelines import infer_watch

    if math.isfinite(config.watch.timeout) and not watch:
        raise typer.BadParameter("--watch-timeout goes with --watch")
    if weights["peer"] is not None and config.method not in TRAINED_METHODS:
        known = ", ".join(TRAINED_METHODS)
        raise typer.BadParameter(f"--weights goes with a compared --method: {known}")
    if out.suffix not in HDF5_SUFFIXES:
        raise typer.BadParameter(f"--out is {out}; it must be a file name that ends in .h5")
    config, allowed = _with_workspace(config, workspace)
    paths = stage.InferPaths(frames, out, overlays, masks, workspace=allowed).with_weights(
        **weights
    )
    if watch and frames.is_dir() and not report_style().quiet:
        typer.echo(printable(f"watching {frames} until Ctrl-C"), err=True)
    followed = partial(infer_watch.run, watch=config.watch, notify=_print_outcome)
    report = (followed if watch else stage.run)(
        paths,
        as_config(InferConfig, config),
        options,
        stated=stated,
        seed=seed,
        device=device,
        timings=timings,
        choice=choice,
    )
    _conclude(report, out, overlays)


def _with_workspace(
    config: InferSettings, workspace: str | None
) -> tuple[InferSettings, Path | None]:
    """Return the settings with the box that `workspace` states, or the mask that it names."""
    from pipelines.frames.workspace_files import parse_workspace

    box, mask = parse_workspace(workspace)
    if box:
        config = changed(config, {"limits.box": box}, option="--workspace")
    if workspace is None and not config.limits.box and config.limits.box_frame != DEFAULT_FRAME:
        raise typer.BadParameter("--workspace-frame goes with a box of --workspace")
    return config, mask


def _conclude(report: "StageReport", out: Path, overlays: Path | None) -> None:
    """Report the numbers of grasps and frames, and why some frames have no grasp."""
    from pipelines.grasp_files.grasps_summary import summary_of

    summary = summary_of(out) if out.exists() else None
    if summary is None:
        conclude(report, out, overlays)
        return
    reasons = summary.empty.values()
    report.notes = {name: note for name, note in report.notes.items() if note not in reasons}
    facts = {"frames": summary.frames, "grasps": summary.grasps, "empty": summary.empty}
    then = ("view", out, "--out", "view")
    conclude(report, out, overlays, then=then, lines=list(summary.lines()), facts=facts)


def _print_outcome(frame: "FrameOutcome") -> None:
    """Print one frame's line on stdout at once, for a reader at the end of a pipe.

    A watch without a reader would work for nobody, so it ends, and not without a word.
    """
    if report_style().as_json:
        line = json.dumps({**asdict(frame), "seconds": round(frame.seconds, 3)})
    else:
        grasps = counted(frame.grasps, "grasp")
        facts = f"{frame.status}  {grasps}  {frame.seconds:.2f} s"
        line = printable(f"{frame.name}  {facts}  {frame.text}")
    try:
        typer.echo(line)
        sys.stdout.flush()
    except BrokenPipeError:
        sentence = "error: the reader of stdout has gone; the same command continues from here"
        typer.echo(sentence, err=True)
        raise
