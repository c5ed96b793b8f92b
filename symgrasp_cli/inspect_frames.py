"""`symgrasp inspect`."""

from typing import Annotated

import typer

from pipelines.configs import InspectConfig
from symgrasp_cli.options import DepthUnitsPerMetre, FrameFolder, IntrinsicsText
from symgrasp_cli.report import conclude


def inspect(
    frames: FrameFolder,
    *,
    max_frames: Annotated[
        int, typer.Option(min=1, help="Frames to read, evenly spread where there are more.")
    ] = InspectConfig.max_frames,
    intrinsics: IntrinsicsText = None,
    depth_units_per_metre: DepthUnitsPerMetre = None,
) -> None:
    """Say what would be read of RGB-D frames, and what is odd about them."""
    from pipelines import inspect_frames as stage
    from pipelines.frames.camera_files import parse_camera

    findings = stage.run(
        frames,
        InspectConfig(max_frames=max_frames),
        camera=None if intrinsics is None else parse_camera(intrinsics),
        depth_units_per_metre=depth_units_per_metre,
    )
    for line in stage.findings_lines(findings):
        typer.echo(line)
    conclude(findings.report)
