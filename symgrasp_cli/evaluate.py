"""`symgrasp evaluate`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import EvaluateConfig, EvaluateDumpConfig
from pipelines.configs.settings import settings_of
from pipelines.configs.stages import EvaluateSettings, as_config
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import DatasetRoot, Seed, With
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings

PROTOCOLS = ("symgrasp", "graspnet")


Success = Annotated[
    list[Path] | None,
    typer.Option(
        exists=True,
        dir_okay=False,
        help="success.json of `simulate`, of these grasps or of a row of --with: Table III; "
        "may be given again.",
    ),
]
FurtherTables = Annotated[
    list[Path] | None,
    typer.Option(
        "--table",
        exists=True,
        dir_okay=False,
        help="Further table for the report: JSON with title, header, rows of text and note; "
        "may be given again.",
    ),
]


@with_settings(
    "evaluate",
    named_as("graspnet.exact", "graspnet.frame_stride", "gripper", "min_visible_pixels", "unit"),
)
def evaluate(
    config: EvaluateSettings,
    grasps: Annotated[
        Path,
        typer.Argument(
            exists=True,
            help="grasps.h5 of `infer` on the dataset; with --protocol graspnet the folder of "
            "another detector's dump, scene_NNNN/CAMERA/NNNN.npy.",
        ),
    ],
    *,
    dataset: DatasetRoot,
    out: Annotated[Path, typer.Option(help="Report to write; a page, .html, goes next to it.")] = (
        Path("report.json")
    ),
    protocol: Annotated[
        str,
        typer.Option(
            help="symgrasp: quality of the best grasp per object, symmetries, masks; graspnet: "
            "graspnetAPI's AP of a dump, its faults included."
        ),
    ] = "symgrasp",
    with_: With = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Also score oracle, planar-critic, planar and random on the same regions.",
        ),
    ] = False,
    success: Success = None,
    table: FurtherTables = None,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Score grasps, symmetries and masks against a dataset: report, tables, baselines."""
    from pipelines.storage.provenance import refuse_other_suffix

    refuse_other_suffix(out, ".json")
    needs_grasps = bool(with_) or baselines or bool(success) or bool(table)
    _refuse_mixtures(grasps, protocol, config.graspnet, needs_grasps=needs_grasps)
    _refuse_settings_without_effect(config, protocol)
    if protocol == "graspnet":
        from pipelines import evaluate_dump

        report = evaluate_dump.run(grasps, dataset, out, config.graspnet, options)
        tables_of = evaluate_dump.tables
    else:
        from pipelines import evaluate as stage

        report = stage.run(
            grasps,
            dataset,
            out,
            as_config(EvaluateConfig, config),
            options,
            others=with_ or (),
            baselines=baselines,
            success=success or (),
            tables=table or (),
            unit=config.unit,
            seed=seed,
        )
        tables_of = stage.tables
    written = not options.dry_run and out.exists() and bool(report.done or report.skipped)
    conclude(report, out, out.with_suffix(".html"), tables=tables_of(out) if written else ())


def _refuse_mixtures(
    grasps: Path, protocol: str, of_dumps: EvaluateDumpConfig, *, needs_grasps: bool
) -> None:
    """Refuse options that do not go together: wrong usage, exit code 2."""
    if protocol not in PROTOCOLS:
        raise typer.BadParameter(f"{protocol!r} is not known; known are {', '.join(PROTOCOLS)}")
    if protocol == "graspnet" and not grasps.is_dir():
        raise typer.BadParameter(
            f"{grasps} is a file; --protocol graspnet takes the folder of a dump, which "
            "`symgrasp export` makes of a grasps.h5"
        )
    if protocol == "graspnet" and needs_grasps:
        raise typer.BadParameter(
            "--with, --baselines, --success and --table go with a grasps.h5, not with a dump"
        )
    if protocol != "graspnet" and grasps.is_dir():
        raise typer.BadParameter(f"{grasps} is a folder; give a grasps.h5, or --protocol graspnet")
    if protocol != "graspnet" and of_dumps.exact:
        raise typer.BadParameter("--exact goes with --protocol graspnet; symgrasp is always exact")
    if protocol != "graspnet" and of_dumps.frame_stride > 1:
        raise typer.BadParameter(
            "--frame-stride goes with --protocol graspnet; a grasps.h5 names its frames itself"
        )


def _refuse_settings_without_effect(config: EvaluateSettings, protocol: str) -> None:
    """Refuse changed settings that the other protocol uses: wrong usage, exit code 2."""
    is_dump = protocol == "graspnet"
    unused = [
        each.name
        for each in settings_of(config)
        if each.value != each.default and each.name.startswith("graspnet.") != is_dump
    ]
    if unused:
        raise typer.BadParameter(
            f"the setting{'s' if unused[1:] else ''} {', '.join(unused)}: no effect with "
            f"--protocol {protocol}; give only settings of this protocol"
        )
