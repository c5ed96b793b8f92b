"""`symgrasp workspace`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import WorkspaceConfig
from symgrasp_cli.arguments import CameraAndUnits
from symgrasp_cli.options import FrameFolder, Overwrite
from symgrasp_cli.report import conclude, report_style
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "workspace",
    {"--workspace": "box", "--workspace-frame": "box_frame", **named_as("margin", "max_frames")},
)
def workspace(
    config: WorkspaceConfig,
    frames: FrameFolder,
    *,
    out: Annotated[Path, typer.Option(help="Folder of pictures and masks to write.")] = (
        Path("workspace")
    ),
    stated: CameraAndUnits,
    overwrite: Overwrite = False,
) -> None:
    """Draw the table frame and a workspace into frames, and print its options for infer."""
    from pipelines import workspace as stage

    found = stage.run(frames, out, config, stated=stated, overwrite=overwrite)
    options = found.options()
    if options is not None and not report_style().as_json:
        typer.echo(options)
    facts = {
        "options": options,
        "boxes": {
            name: {"frame": box.frame, "corners": box.corners.tolist()}
            for name, box in found.boxes.items()
        },
    }
    conclude(found.report, out, facts=facts)
