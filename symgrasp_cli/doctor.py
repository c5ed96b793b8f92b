"""`symgrasp doctor`."""

import typer

from pipelines.configs import DoctorConfig
from symgrasp_cli.report import report_style
from symgrasp_cli.settings import with_settings

WIDTH = 24  # characters of the column of names; longer than any name


@with_settings("doctor", {})
def doctor(config: DoctorConfig) -> None:
    """Check this machine: packages, GPU, weights, and a frame with known grasps."""
    import json

    from pipelines import doctor as stage

    checks = []
    for check in stage.run(config):
        checks.append(check)
        if not report_style().as_json:
            typer.echo(f"{check.name:<{WIDTH}}{check.status:<6}{check.text}")
    code = stage.exit_code(checks)
    if report_style().as_json:
        rows = [{"name": c.name, "status": c.status, "text": c.text} for c in checks]
        report = {"command": stage.STAGE, "ok": code == 0, "checks": rows}
        typer.echo(json.dumps(report, indent=1))
    if code:
        raise typer.Exit(code)
