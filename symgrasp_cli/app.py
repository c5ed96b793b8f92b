"""The `symgrasp` command: all commands in workflow order, and the one error boundary."""

import logging
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from pipelines.errors import SymgraspError, error_sentence, printable
from symgrasp_cli.annotate_symmetry import annotate_symmetry
from symgrasp_cli.compare import compare
from symgrasp_cli.config import config
from symgrasp_cli.convert_frames import convert_frames
from symgrasp_cli.doctor import doctor
from symgrasp_cli.evaluate import evaluate
from symgrasp_cli.export import export
from symgrasp_cli.export_coco import export_coco
from symgrasp_cli.finetune_detector import finetune_detector
from symgrasp_cli.gripper import gripper
from symgrasp_cli.infer import infer
from symgrasp_cli.inspect_frames import inspect
from symgrasp_cli.label_grasps import label_grasps
from symgrasp_cli.pack import pack
from symgrasp_cli.refine_grasps import refine_grasps
from symgrasp_cli.report import failure_as_json
from symgrasp_cli.score_grasps import score_grasps
from symgrasp_cli.serve import serve
from symgrasp_cli.simulate import simulate
from symgrasp_cli.synthesize import synthesize
from symgrasp_cli.train import train
from symgrasp_cli.train_baseline import train_baseline
from symgrasp_cli.train_critic import train_critic
from symgrasp_cli.view import view
from symgrasp_cli.workspace import workspace

# The order in which a lab runs them; `symgrasp --help` teaches the workflow.
COMMANDS = (
    doctor,
    config,
    synthesize,
    label_grasps,
    annotate_symmetry,
    refine_grasps,
    pack,
    export_coco,
    finetune_detector,
    train,
    train_critic,
    train_baseline,
    inspect,
    convert_frames,
    gripper,
    workspace,
    infer,
    serve,
    view,
    export,
    score_grasps,
    simulate,
    evaluate,
    compare,
)


class PlainFormatter(logging.Formatter):
    """Messages in one line, whatever names they contain; tracebacks follow unchanged."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Return the message without characters that move a terminal's cursor."""
        return printable(super().formatMessage(record))


class SymgraspGroup(TyperGroup):
    """Report expected errors as one line, exit 1 or 2; all others show their traceback.

    Expected are a `SymgraspError`, an error of the system (a folder without write permission, a
    full disk) and a torchvision that was built for another torch.
    """

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ANN401 - click's or typer's own
        """Return the commands in workflow order."""
        return list(self.commands)

    def parse_args(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - click's or typer's own
        """Keep the arguments for `invoke`, and parse them."""
        ctx.obj = tuple(args)
        with failure_as_json(ctx.obj):
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - click's or typer's own
        """Run the command inside the error boundary."""
        try:
            with failure_as_json(ctx.obj):
                return super().invoke(ctx)
        except SymgraspError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(error.exit_code) from error
        except BrokenPipeError:  # the reader has closed the pipe: click ends quietly
            raise
        except OSError as error:
            typer.echo(f"error: {error_sentence(error)}", err=True)
            raise typer.Exit(1) from error
        except (ImportError, RuntimeError) as error:
            from pipelines.health.packages import foreign_torchvision

            sentence = foreign_torchvision(error)
            if sentence is None:
                raise
            typer.echo(f"error: torchvision {sentence}", err=True)
            raise typer.Exit(1) from error


app = typer.Typer(
    cls=SymgraspGroup,
    name="symgrasp",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from pipelines.storage.provenance import version

        typer.echo(f"symgrasp {version()}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more on stderr.")] = False,
) -> None:
    """Symmetry-aware antipodal grasps from single-view RGB-D images."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(PlainFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, handlers=[handler])
    # trimesh's parsers log tracebacks of content that they skip, such as missing textures.
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)


for command in COMMANDS:
    app.command(context_settings={"help_option_names": ["-h", "--help"]})(command)
