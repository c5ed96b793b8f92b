"""`symgrasp convert-frames`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ConvertFramesConfig
from symgrasp_cli.arguments import CameraAndUnits
from symgrasp_cli.options import FrameFolder, Overwrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings("convert-frames", named_as("trust_pickle"))
def convert_frames(
    config: ConvertFramesConfig,
    frames: FrameFolder,
    *,
    out: Annotated[Path, typer.Option(help="Folder to write.")],
    stated: CameraAndUnits,
    overwrite: Overwrite = False,
) -> None:
    """Write RGB-D frames of any layout as colour and depth images with camera files."""
    from pipelines import convert_frames as stage

    report = stage.run(frames, out, config, stated=stated, overwrite=overwrite)
    conclude(report, out, then=("infer", out))
