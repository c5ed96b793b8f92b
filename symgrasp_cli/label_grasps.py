"""`symgrasp label-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import LabelGraspsConfig
from symgrasp_cli.options import Backend, DryRun, MeshUnit, Overwrite, Seed, Workers, batch_options
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
    out: Annotated[Path, typer.Option(help="Dataset root to write; may be the root that is read.")],
    mesh_scale: MeshUnit = None,
    sdf: Annotated[
        bool, typer.Option(help="Write textured.sdf too, as dex-net does: 10 MB an object.")
    ] = True,
    compress: Annotated[
        bool, typer.Option("--compress", help="Zip the labels: far smaller, slower to read.")
    ] = False,
    seed: Seed = 0,
    workers: Workers = None,
    backend: Backend = "loky",
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Label grasps on your own meshes, in GraspNet-1Billion's layout."""
    from pipelines import label_grasps as stage

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
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
