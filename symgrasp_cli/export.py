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
    {
        "--to": "to",
        "--gripper": "gripper",
        "--min-score": "min_score",
        "--tcp": "tcp",
        "--frame-id": "frame_id",
    },
)
def export(
    config: ExportConfig,
    grasps: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer`.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder to write; for json and csv the file.")],
    camera_to_base: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="Hand-eye calibration (4 x 4 matrix, easy_handeye, MoveIt): poses are then in "
            "the robot's base frame.",
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write grasps in the formats of other tools."""
    from pipelines import export as stage

    report = stage.run(grasps, out, config, camera_to_base=camera_to_base, overwrite=overwrite)
    conclude(report, out)
