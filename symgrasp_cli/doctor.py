"""`symgrasp doctor`."""

from typing import Annotated

import typer

from pipelines.configs import DoctorConfig
from symgrasp_cli.settings import with_settings

WIDTH = 24  # of the names; longer than any of ours


@with_settings("doctor", {})
def doctor(
    config: DoctorConfig,
    *,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of lines.")
    ] = False,
) -> None:
    """Say whether this machine is fit: packages, GPU, weights, and a frame with known grasps."""
    import json

    from pipelines import doctor as stage

    checks = []
    for check in stage.run(config):
        checks.append(check)
        if not as_json:
            typer.echo(f"{check.name:<{WIDTH}}{check.status:<6}{check.text}")
    code = stage.exit_code(checks)
    if as_json:
        rows = [{"name": c.name, "status": c.status, "text": c.text} for c in checks]
        typer.echo(json.dumps({"ok": code == 0, "checks": rows}, indent=1))
    if code:
        raise typer.Exit(code)
