"""`symgrasp annotate-symmetry`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import AnnotateSymmetryConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import MeshUnit, Seed
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings("annotate-symmetry", {"--cut/--no-cut": "cut_objects"})
def annotate_symmetry(
    config: AnnotateSymmetryConfig,
    source: Annotated[
        Path,
        typer.Argument(
            exists=True,
            help="Dataset root with models/, or a mesh, or a folder of meshes: glb, obj, off, ply, "
            "stl. Convert STEP first, as `gmsh NAME.step -2 -o NAME.stl` does.",
        ),
    ],
    *,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for NAME.json of loose meshes; a dataset has symmetry/."),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(help="Folder for contact sheets, the most doubtful objects first."),
    ] = None,
    edit: Annotated[
        Path | None,
        typer.Option(
            exists=True, help="Manual corrections, JSON: drop, fix, add or accept a symmetry."
        ),
    ] = None,
    bop_symmetries: Annotated[
        Path | None,
        typer.Option(
            exists=True, help="BOP's models_info.json: its rotations override found ones."
        ),
    ] = None,
    bop: Annotated[
        Path | None, typer.Option(help="BOP's models_info.json to write: sizes and rotations.")
    ] = None,
    mesh_scale: MeshUnit = None,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Find the symmetries and the symmetric regions of meshes."""
    from pipelines import annotate_symmetry as stage
    from pipelines.annotation.extras import AnnotationExtras

    extras = AnnotationExtras(edit, bop_symmetries, bop, pictures)
    report = stage.run(
        source, out, config, extras=extras, seed=seed, mesh_scale=mesh_scale, options=options
    )
    symmetries = source / "symmetry" if out is None else out
    is_labelled = symmetries == source / "symmetry" and (source / "grasp_label").is_dir()
    then = ("refine-grasps", source) if is_labelled else ()
    conclude(report, symmetries, pictures, bop, then=then)
