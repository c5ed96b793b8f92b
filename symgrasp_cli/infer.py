"""`symgrasp infer`."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.configs import InferConfig, LimitsConfig, SelectionConfig, WatchConfig
from symgrasp_cli.options import (
    Backend,
    DepthUnitsPerMetre,
    Device,
    DryRun,
    FrameFolder,
    IntrinsicsText,
    Overwrite,
    Seed,
    batch_options,
)
from symgrasp_cli.report import conclude

if TYPE_CHECKING:
    from pipelines.infer_watch import Followed


def infer(
    frames: FrameFolder,
    out: Annotated[Path, typer.Option(help="The file of grasps to write.")] = Path("grasps.h5"),
    overlays: Annotated[
        Path | None, typer.Option(help="Folder for a picture of every frame's grasps.")
    ] = None,
    regions: Annotated[
        str,
        typer.Option(
            help="Where regions come from: detector, geometric (what stands on the table), or "
            "auto, the detector's completed with geometric ones."
        ),
    ] = "auto",
    masks: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            file_okay=False,
            help="Folder of instance masks, NAME_label.png, to use as regions instead.",
        ),
    ] = None,
    gripper: Annotated[
        str, typer.Option(help="rg2, robotiq_2f85, franka, or the path of a TOML file.")
    ] = "rg2",
    method: Annotated[
        str, typer.Option(help="network, or planar or random as baselines without it.")
    ] = "network",
    mirrored: Annotated[
        bool,
        typer.Option("--mirrored", help="Show the network each region's mirror image too."),
    ] = InferConfig.mirrored,
    grounding: Annotated[
        bool, typer.Option(help="Fit predicted symmetries to the surface that is seen.")
    ] = SelectionConfig.ground_symmetries,
    rank_by: Annotated[
        str, typer.Option(help="critic, the quality to expect of each grasp, or eq8, as the paper.")
    ] = SelectionConfig.rank_by,
    top: Annotated[
        int, typer.Option(min=1, help="Grasps a region at most, each different from the others.")
    ] = InferConfig.max_grasps_per_region,
    workspace: Annotated[
        str | None,
        typer.Option(
            help="Only grasps in there: a mask picture, black outside, of the depth's size, or a "
            "box x0,y0,z0,x1,y1,z1 in metres."
        ),
    ] = None,
    workspace_frame: Annotated[
        str, typer.Option(help="Of the box: camera, or table (z up, below the camera 0).")
    ] = LimitsConfig.box_frame,
    approach_cone: Annotated[
        float, typer.Option(help="Degrees that approaches are off the direction at most.")
    ] = LimitsConfig.approach_cone,
    approach_direction: Annotated[
        str, typer.Option(help="x,y,z of the cone's axis, from hand to object.")
    ] = "0,0,-1",
    approach_frame: Annotated[
        str, typer.Option(help="Of that direction: table, or camera.")
    ] = LimitsConfig.approach_frame,
    intrinsics: IntrinsicsText = None,
    depth_units_per_metre: DepthUnitsPerMetre = None,
    detector: Annotated[
        Path | None,
        typer.Option(exists=True, help="Weights of the region detector, if not the default."),
    ] = None,
    network: Annotated[
        Path | None,
        typer.Option(exists=True, help="Weights of the grasp network, if not the default."),
    ] = None,
    axis_critic: Annotated[
        Path | None,
        typer.Option(exists=True, help="Weights of the axis critic, if not the default."),
    ] = None,
    plane_critic: Annotated[
        Path | None,
        typer.Option(exists=True, help="Weights of the plane critic, if not the default."),
    ] = None,
    grasp_critic: Annotated[
        Path | None,
        typer.Option(exists=True, help="Weights of the grasp critic, if not the default."),
    ] = None,
    timings: Annotated[
        bool,
        typer.Option("--timings", help="Write each frame's seconds; files then differ by run."),
    ] = False,
    watch: Annotated[
        bool,
        typer.Option("--watch", help="Follow a folder that a camera writes into, until Ctrl-C."),
    ] = False,
    watch_timeout: Annotated[
        float | None,
        typer.Option(min=0.0, help="Seconds without a new frame after which --watch ends."),
    ] = None,
    device: Device = "auto",
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes that work at a time, 1 for threads of one; by default 2 for many "
            "frames on a CPU, else 1.",
        ),
    ] = None,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Find ranked grasps in RGB-D frames."""
    from pipelines import infer as stage
    from pipelines import infer_watch
    from pipelines.frames.camera_files import parse_camera
    from pipelines.frames.workspace_files import parse_direction, parse_workspace
    from pipelines.runtime.batch import CHOSEN

    if watch_timeout is not None and not watch:
        raise typer.BadParameter("--watch-timeout goes with --watch")
    if workspace is None and workspace_frame != LimitsConfig.box_frame:
        raise typer.BadParameter("--workspace-frame goes with a box of --workspace")
    room, direction = parse_workspace(workspace), parse_direction(approach_direction)
    paths = stage.InferPaths(frames, out, overlays, masks, room.mask)
    paths = paths.with_weights(
        detector=detector,
        network=network,
        axis_critic=axis_critic,
        plane_critic=plane_critic,
        grasp_critic=grasp_critic,
    )
    config = InferConfig(
        regions=regions,
        method=method,
        mirrored=mirrored,
        gripper=gripper,
        max_grasps_per_region=top,
        limits=LimitsConfig(room.box, workspace_frame, approach_cone, direction, approach_frame),
        selection=SelectionConfig(ground_symmetries=grounding, rank_by=rank_by),
    )
    chosen = CHOSEN if workers is None else workers
    options = batch_options(chosen, backend, overwrite=overwrite, dry_run=dry_run)
    followed = partial(
        infer_watch.run, watch=WatchConfig(timeout=watch_timeout), tell=_tell_followed
    )
    report = (followed if watch else stage.run)(
        paths,
        config,
        options,
        camera=None if intrinsics is None else parse_camera(intrinsics),
        depth_units_per_metre=depth_units_per_metre,
        seed=seed,
        device=device,
        timings=timings,
    )
    conclude(report)


def _tell_followed(frame: Followed) -> None:
    """Print one frame's line on stdout at once, for whoever reads it through a pipe."""
    line = f"{frame.name}  {frame.status}  {frame.grasps} grasps  {frame.seconds:.2f} s"
    typer.echo(f"{line}  {frame.text}")
    sys.stdout.flush()
