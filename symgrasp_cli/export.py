"""`symgrasp export`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportConfig
from symgrasp_cli.options import Overwrite
from symgrasp_cli.report import conclude


def export(
    grasps: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer`.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder to write; for json and csv the file.")],
    to: Annotated[
        str,
        typer.Option(
            help="Format: graspnet (graspnetAPI's dump), contact-graspnet, isaac (isaac_grasp "
            "YAML), json, csv, or ros-json (PoseArray)."
        ),
    ] = ExportConfig.to,
    gripper: Annotated[
        str,
        typer.Option(
            help="Gripper preset or TOML file whose base the poses are of, and that must open wide "
            "enough; by default the one of the grasps."
        ),
    ] = ExportConfig.gripper,
    overwrite: Overwrite = False,
) -> None:
    """Write grasps in the formats of other tools."""
    from pipelines import export as stage

    conclude(stage.run(grasps, out, ExportConfig(to=to, gripper=gripper), overwrite=overwrite))
