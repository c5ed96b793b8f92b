"""`symgrasp annotate-symmetry`."""

from pathlib import Path
from typing import Annotated

import typer

from symgrasp_cli.options import Backend, DryRun, Overwrite, Seed, Workers, batch_options
from symgrasp_cli.report import conclude


def annotate_symmetry(
    source: Annotated[
        Path,
        typer.Argument(help="Dataset root with models/, or a mesh, or a folder of meshes."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for NAME.json of loose meshes; a dataset has symmetry/."),
    ] = None,
    workers: Workers = 1,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Find the symmetries and the symmetric regions of meshes."""
    from pipelines import annotate_symmetry as stage
    from pipelines.configs import AnnotateSymmetryConfig

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    config = AnnotateSymmetryConfig()
    conclude(stage.run(source, out, config, seed=seed, options=options))
