"""`symgrasp serve`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import InferConfig, ServeConfig
from pipelines.configs.stages import ServeSettings, as_config
from pipelines.ending import set_farewell
from symgrasp_cli.arguments import SymmetryModels
from symgrasp_cli.options import Device, GraspCriticWeights, Seed
from symgrasp_cli.report import report_style
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "serve",
    {
        **named_as("gripper", "http.min_score", "http.tcp"),
        **named_as("http.host", "http.port", "http.parallel", "http.max_waiting"),
    },
)
def serve(
    config: ServeSettings,
    *,
    camera_to_base: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="Hand-eye calibration (4 x 4 matrix, easy_handeye, MoveIt): poses are then in "
            "the robot's base frame.",
        ),
    ] = None,
    models: SymmetryModels,
    grasp_critic: GraspCriticWeights = None,
    device: Device = "auto",
    seed: Seed = 0,
) -> None:
    """Answer posted frames with their grasps over HTTP, models loaded once."""
    set_farewell("frames in progress are answered")
    from pipelines import serve as stage
    from symgrasp.detector import GraspDetector

    http = as_config(ServeConfig, config.http)
    detector = GraspDetector(
        device=device,
        settings=as_config(InferConfig, config),
        detector=models["detector"],
        network=models["network"],
        axis_critic=models["axis_critic"],
        plane_critic=models["plane_critic"],
        grasp_critic=grasp_critic,
        seed=seed,
    )
    app = stage.app_of(detector.frame_result, detector.gripper, http, camera_to_base)
    sockets = stage.listening(http)
    if not report_style().quiet:
        port = sockets[0].getsockname()[1]
        host = f"[{http.host}]" if ":" in http.host else http.host  # an address of IPv6
        typer.echo(f"serving on http://{host}:{port}/grasps until Ctrl-C", err=True)
        if http.host not in stage.LOOPBACK:
            typer.echo("other machines can reach the server, which asks for no password", err=True)
    stage.run(app, http, sockets)
