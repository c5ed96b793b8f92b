"""`symgrasp serve`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.configs import InferConfig, ServeConfig
from pipelines.configs.stages import ServeSettings, as_config
from pipelines.ending import set_farewell
from pipelines.errors import SymgraspError
from symgrasp_cli.arguments import SymmetryModels
from symgrasp_cli.options import Device, GraspCriticWeights, Seed
from symgrasp_cli.report import report_style
from symgrasp_cli.settings import named_as, with_settings

if TYPE_CHECKING:
    from symgrasp.detector import GraspDetector

# Metres, in either frame: a box of the settings may leave out all objects of the bundled frame.
EVERYWHERE = (-9, -9, -9, 9, 9, 9)


@with_settings(
    "serve",
    {
        **named_as("gripper", "http.min_score", "http.tcp"),
        **named_as("http.host", "http.port", "http.parallel", "http.max_waiting", "http.max_wait"),
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
    _compile_loops(detector)
    sockets = stage.listening(http)
    if not report_style().quiet:
        port = sockets[0].getsockname()[1]
        host = f"[{http.host}]" if ":" in http.host else http.host  # an address of IPv6
        typer.echo(f"serving on http://{host}:{port}/grasps until Ctrl-C", err=True)
        if http.host not in stage.LOOPBACK:
            typer.echo("other machines can reach the server, which asks for no password", err=True)
    stage.run(app, http, sockets)


def _compile_loops(detector: "GraspDetector") -> None:
    """Find the grasps of a bundled frame, so that no post waits for compilation or loading."""
    from symgrasp.bundled_frames import bundled_frame

    try:
        detector.frame_result(*bundled_frame(), workspace=EVERYWHERE)
    except SymgraspError as error:  # settings may suit the posted frames, but not this one
        if not report_style().quiet:
            typer.echo(f"the first post takes longer, as a bundled frame fails: {error}", err=True)
