"""`symgrasp gripper`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import GripperConfig
from symgrasp_cli.options import Overwrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


class Task(StrEnum):
    """The task of the command."""

    FROM_URDF = "from-urdf"
    CHECK = "check"


@with_settings("gripper", named_as("base_link", "tip_reach", "clearance"))
def gripper(
    config: GripperConfig,
    task: Annotated[
        Task, typer.Argument(help="from-urdf: measure a URDF; check: verify a TOML file.")
    ],
    source: Annotated[str, typer.Argument(help="URDF, TOML file or preset.")],
    *,
    out: Annotated[
        Path | None, typer.Option(help="TOML file to write; needed with from-urdf.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="PNG to write; by default next to --out.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Measure a gripper's URDF, or check a gripper's file, with a picture."""
    from pipelines import gripper as stage

    if (task is Task.FROM_URDF) != (out is not None):
        raise typer.BadParameter("from-urdf needs --out FILE.toml, check takes none")
    if (task is Task.FROM_URDF) != (Path(source).suffix.lower() in (".urdf", ".xml")):
        raise typer.BadParameter("from-urdf takes a .urdf, check a .toml or a preset's name")
    if picture is None and out is not None:
        picture = out.with_suffix(".png")
    report = stage.run(source, config, output=out, picture=picture, overwrite=overwrite)
    conclude(report, out, picture)
