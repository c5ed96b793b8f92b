"""`symgrasp export`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportConfig
from symgrasp_cli.options import (
    GripperUsed,
    Overwrite,
)
from symgrasp_cli.report import conclude


def export(
    grasps: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer`.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder to write.")],
    to: Annotated[
        str, typer.Option(help="Format: graspnet, graspnetAPI's dump of 17 columns a grasp.")
    ] = ExportConfig.to,
    gripper: GripperUsed = ExportConfig.gripper,
    overwrite: Overwrite = False,
) -> None:
    """Write grasps in the formats of other tools."""
    from pipelines import export as stage

    conclude(stage.run(grasps, out, ExportConfig(to=to, gripper=gripper), overwrite=overwrite))
