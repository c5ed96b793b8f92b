"""`symgrasp export`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportConfig
from symgrasp_cli.options import GraspsToRead, Overwrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings("export", named_as("to", "gripper", "min_score", "tcp", "frame_id"))
def export(
    config: ExportConfig,
    grasps: GraspsToRead,
    *,
    out: Annotated[Path, typer.Option(help="Folder to write; for json and csv the file.")],
    camera_to_base: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            metavar="FILE",
            help="Hand-eye calibration (4 x 4 matrix, easy_handeye, MoveIt), or a folder with the "
            "camera's pose in each frame, NAME.json: poses are then in the robot's base frame.",
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write grasps in the formats of other tools."""
    from pipelines import export as stage

    report = stage.run(grasps, out, config, camera_to_base=camera_to_base, overwrite=overwrite)
    conclude(report, out)
