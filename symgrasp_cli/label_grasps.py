"""`symgrasp label-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import LabelGraspsConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import MeshUnit, Seed
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "label-grasps",
    {"--grasp-points": "labels.num_points", "--max-width": "labels.max_width"},
    hidden={"--points": "labels.num_points"},
)
def label_grasps(
    config: LabelGraspsConfig,
    meshes: Annotated[
        Path,
        typer.Argument(
            exists=True, help="A mesh, a folder of meshes, or a dataset root with models/."
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Dataset root to write; may be the root that is read.")],
    mesh_scale: MeshUnit = None,
    sdf: Annotated[
        bool, typer.Option(help="Write textured.sdf too, as dex-net does: 10 MB per object.")
    ] = True,
    compress: Annotated[
        bool, typer.Option("--compress", help="Zip the labels: far smaller, slower to read.")
    ] = False,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Label grasps on your own meshes, in GraspNet-1Billion's layout."""
    from pipelines import label_grasps as stage

    report = stage.run(
        meshes,
        out,
        config,
        seed=seed,
        mesh_scale=mesh_scale,
        sdf=sdf,
        compress=compress,
        options=options,
    )
    conclude(report, out, then=("annotate-symmetry", out))
