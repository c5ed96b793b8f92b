"""`symgrasp inspect`."""

from typing import TYPE_CHECKING

import typer

from pipelines.configs import InspectConfig
from pipelines.errors import printable
from symgrasp_cli.arguments import CameraAndUnits
from symgrasp_cli.options import FrameFolder
from symgrasp_cli.report import conclude, report_style
from symgrasp_cli.settings import named_as, with_settings

if TYPE_CHECKING:
    from pipelines.frames.frame_options import FrameOptions

OPTION = "--intrinsics"


@with_settings("inspect", named_as("max_frames"))
def inspect(config: InspectConfig, frames: FrameFolder, *, stated: CameraAndUnits) -> None:
    """Report how RGB-D frames would be read, and everything odd about them."""
    from pipelines import inspect_frames as stage

    findings = stage.run(frames, config, stated=stated)
    lines = list(stage.findings_lines(findings))
    if not report_style().as_json:
        for line in lines:
            typer.echo(printable(line))
    then = ["infer", str(frames), *_options(stated)]
    conclude(findings.report, then=then, facts={"findings": lines})


def _options(stated: "FrameOptions") -> list[str]:
    """Return the options with which `infer` reads the frames as they were read here."""
    options = []
    if (camera := stated.camera) is not None:
        four = ",".join(f"{each:.10g}" for each in (camera.fx, camera.fy, camera.cx, camera.cy))
        options += [OPTION, four if camera.origin == OPTION else camera.origin]
    if stated.depth_units_per_metre is not None:
        options += ["--depth-units-per-metre", f"{stated.depth_units_per_metre:.10g}"]
    return options
