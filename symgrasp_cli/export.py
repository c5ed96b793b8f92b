"""`symgrasp export`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportConfig
from symgrasp_cli.options import CameraToBase, GraspsToRead, Overwrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings("export", named_as("to", "gripper", "min_score", "tcp", "frame_id"))
def export(
    config: ExportConfig,
    grasps: GraspsToRead,
    *,
    out: Annotated[Path, typer.Option(help="Folder to write; for json and csv the file.")],
    camera_to_base: CameraToBase = None,
    overwrite: Overwrite = False,
) -> None:
    """Write grasps in the formats of other tools."""
    from pipelines import export as stage

    report = stage.run(grasps, out, config, camera_to_base=camera_to_base, overwrite=overwrite)
    conclude(report, out)
