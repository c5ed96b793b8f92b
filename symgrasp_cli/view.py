"""`symgrasp view`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ViewConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import GraspsToRead
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings("view", named_as("gripper", "max_pixels"))
def view(
    config: ViewConfig,
    grasps: GraspsToRead,
    *,
    out: Annotated[Path, typer.Option(help="Folder to write; open its index.html.")],
    frames: Annotated[
        Path | None,
        typer.Option(
            exists=True, help="Folder of the RGB-D frames, if they are not where infer read them."
        ),
    ] = None,
    rerun: Annotated[
        bool, typer.Option("--rerun", help="Also write NAME.rrd for rerun's viewer (extra: viz).")
    ] = False,
    options: Batch,
) -> None:
    """Make a page per frame, with cloud, symmetries and grasps in 3D for a browser."""
    from pipelines import view as stage

    report = stage.run(stage.ViewPaths(grasps, out, frames), config, options, rerun=rerun)
    conclude(report, out / "index.html")
