"""`symgrasp refine-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import RefineGraspsConfig
from symgrasp_cli.options import Backend, DryRun, Overwrite, Seed, Workers, batch_options
from symgrasp_cli.report import conclude


def refine_grasps(
    root: Annotated[
        Path,
        typer.Argument(exists=True, help="Dataset root with models/, grasp_label/ and symmetry/."),
    ],
    symmetry: Annotated[
        bool,
        typer.Option(
            "--symmetry/--no-symmetry",
            help="Copy grasps across symmetries; without, the labels as they are (ablation).",
        ),
    ] = RefineGraspsConfig.use_symmetry,
    copies_per_turn: Annotated[
        int, typer.Option(min=1, max=72, help="Equal angles about a continuous axis.")
    ] = RefineGraspsConfig.copies_per_turn,
    validate: Annotated[
        bool,
        typer.Option(
            "--validate/--no-validate",
            help="Close each copy's fingers on the mesh anew: what fails is dropped, "
            "the friction is that of the mesh.",
        ),
    ] = RefineGraspsConfig.validate_copies,
    workers: Workers = 1,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Make grasp labels symmetric and spread them to per-point affordance."""
    from pipelines import refine_grasps as stage

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    config = RefineGraspsConfig(
        use_symmetry=symmetry, copies_per_turn=copies_per_turn, validate_copies=validate
    )
    conclude(stage.run(root, config, seed=seed, options=options))
