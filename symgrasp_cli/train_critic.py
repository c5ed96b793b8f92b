"""`symgrasp train-critic`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import TrainCriticConfig
from symgrasp_cli.arguments import CpuRun, Preparation, SymmetryModels
from symgrasp_cli.options import WeightsToWrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "train-critic",
    named_as(
        "infer.gripper", "frame_stride", "epochs", "batch_size", "learning_rate", "decay_epochs"
    ),
)
def train_critic(
    config: TrainCriticConfig,
    critic: Annotated[str, typer.Argument(help="axes, planes or grasps, in this order.")],
    roots: Annotated[
        list[Path],
        typer.Argument(
            exists=True,
            file_okay=False,
            help="Dataset roots with scenes/ and symmetry/ to learn from, best with objects that "
            "neither network was trained on.",
        ),
    ],
    *,
    out: WeightsToWrite,
    calibrate: Annotated[
        list[Path],
        typer.Option(
            exists=True,
            file_okay=False,
            help="Dataset root of objects that no network was trained on; may be given again.",
        ),
    ],
    init: Annotated[
        Path | None, typer.Option(exists=True, help="Critic of the same kind to start from.")
    ] = None,
    models: SymmetryModels,
    request: CpuRun,
    options: Preparation,
) -> None:
    """Train a critic on candidates of datasets: of axes, planes or grasps."""
    from pipelines import train_critic as stage
    from pipelines.learning.critics.collecting import ModelPaths
    from pipelines.learning.critics.kinds import critic_kind

    kind = critic_kind(critic)
    paths = replace(ModelPaths(), **{name: path for name, path in models.items() if path})
    report = stage.run(
        kind,
        roots,
        out,
        config,
        request,
        held_out=calibrate,
        init=init,
        paths=paths,
        options=options,
    )
    option = {"axes": "axis", "planes": "plane", "grasps": "grasp"}[kind.name]
    conclude(report, out, then=("infer", "FRAMES", f"--{option}-critic", out))
