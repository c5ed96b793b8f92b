"""`symgrasp refine-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import RefineGraspsConfig
from symgrasp_cli.options import Backend, DryRun, Overwrite, Seed, Workers, batch_options
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "refine-grasps",
    {
        "--symmetry/--no-symmetry": "use_symmetry",
        "--copies-per-turn": "copies_per_turn",
        "--validate/--no-validate": "validate_copies",
    },
)
def refine_grasps(
    config: RefineGraspsConfig,
    root: Annotated[
        Path,
        typer.Argument(exists=True, help="Dataset root with models/, grasp_label/ and symmetry/."),
    ],
    workers: Workers = None,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Make grasp labels symmetric and spread them to per-point affordance."""
    from pipelines import refine_grasps as stage

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    report = stage.run(root, config, seed=seed, options=options)
    then = ("pack", root, "--out", "packed") if (root / "scenes").is_dir() else ()
    conclude(report, root / "affordance", then=then)
