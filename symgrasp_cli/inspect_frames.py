"""`symgrasp inspect`."""

import typer

from pipelines.configs import InspectConfig
from pipelines.errors import printable
from symgrasp_cli.arguments import CameraAndUnits
from symgrasp_cli.options import FrameFolder
from symgrasp_cli.report import conclude, report_style
from symgrasp_cli.settings import named_as, with_settings


@with_settings("inspect", named_as("max_frames"))
def inspect(config: InspectConfig, frames: FrameFolder, *, stated: CameraAndUnits) -> None:
    """Report how RGB-D frames would be read, and everything odd about them."""
    from pipelines import inspect_frames as stage

    findings = stage.run(frames, config, stated=stated)
    lines = list(stage.findings_lines(findings))
    if not report_style().as_json:
        for line in lines:
            typer.echo(printable(line))
    conclude(findings.report, then=("infer", frames), facts={"findings": lines})
