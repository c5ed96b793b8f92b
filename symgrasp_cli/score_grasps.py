"""`symgrasp score-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ScoreGraspsConfig
from symgrasp_cli.options import MeshUnit, Overwrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "score-grasps",
    named_as("compatible", "clip_width"),
    hidden={"--max-width": "clip_width"},
)
def score_grasps(
    config: ScoreGraspsConfig,
    mesh: Annotated[Path, typer.Argument(exists=True, help="Mesh: glb, obj, off, ply, stl.")],
    grasps: Annotated[
        Path,
        typer.Argument(
            exists=True, help="Grasps (N, 17) in graspnetAPI's format, .npy, object frame."
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Verdicts to write, .npz, one row per grasp.")],
    mesh_scale: MeshUnit = None,
    overwrite: Overwrite = False,
) -> None:
    """Score any grasps on any mesh: contacts, smallest friction, antipodal score, collision."""
    from pipelines import score_grasps as stage

    report = stage.run(mesh, grasps, out, config, mesh_scale=mesh_scale, overwrite=overwrite)
    conclude(report, out)
