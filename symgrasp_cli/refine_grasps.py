"""`symgrasp refine-grasps`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import RefineGraspsConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import Seed
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
    *,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Make grasp labels symmetric and spread them to per-point affordance."""
    from pipelines import refine_grasps as stage

    report = stage.run(root, config, seed=seed, options=options)
    conclude(report, root / "affordance", then=("pack", root, "--out", "packed"))
