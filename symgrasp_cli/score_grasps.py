"""`symgrasp score-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ScoreGraspsConfig
from symgrasp_cli.options import MeshScale, Overwrite
from symgrasp_cli.report import conclude


def score_grasps(
    mesh: Annotated[Path, typer.Argument(exists=True, help="Mesh, metres.")],
    grasps: Annotated[
        Path,
        typer.Argument(
            exists=True, help="Grasps (N, 17) as graspnetAPI has them, .npy, mesh's frame."
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Verdicts to write, .npz, one row a grasp.")],
    compatible: Annotated[
        bool,
        typer.Option(
            "--compatible", help="Verdicts of graspnetAPI, its faults on flat faces included."
        ),
    ] = False,
    mesh_scale: MeshScale = ScoreGraspsConfig.mesh_scale,
    max_width: Annotated[
        float,
        typer.Option(min=0.001, max=1.0, help="Widest opening in metres; wider ones are cut."),
    ] = ScoreGraspsConfig.max_width,
    overwrite: Overwrite = False,
) -> None:
    """Score any grasps on any mesh: contacts, smallest friction, antipodal score, collision."""
    from pipelines import score_grasps as stage

    config = ScoreGraspsConfig(compatible=compatible, mesh_scale=mesh_scale, max_width=max_width)
    conclude(stage.run(mesh, grasps, out, config, overwrite=overwrite))
