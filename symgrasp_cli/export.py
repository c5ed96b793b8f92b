"""`symgrasp export`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportConfig
from symgrasp_cli.options import Overwrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "export",
    {"--to": "to", "--gripper": "gripper"},
)
def export(
    config: ExportConfig,
    grasps: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer`.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder to write; for json and csv the file.")],
    overwrite: Overwrite = False,
) -> None:
    """Write grasps in the formats of other tools."""
    from pipelines import export as stage

    conclude(stage.run(grasps, out, config, overwrite=overwrite), out)
