"""`symgrasp synthesize`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import SynthesizeConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import MeshUnit, Seed
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "synthesize",
    {
        "--split": "splits",
        **named_as("scenes_per_split", "views"),
        "--objects": "objects_per_pool",
        **named_as("families", "sensor", "scenery.surroundings"),
        **named_as("scenery.robot_hands", "scenery.colors", "scenery.depth_faults"),
        "--grasp-points": "labels.num_points",
        "--collision-labels/--no-collision-labels": "collision_labels",
    },
    hidden={"--splits": "splits"},
    composite={
        "--objects-per-scene": ("min_objects", "max_objects"),
        "--size": ("width", "height"),
    },
)
def synthesize(
    config: SynthesizeConfig,
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the dataset.")],
    *,
    models: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            help="Your own meshes instead of procedural objects: a mesh, a folder, or a dataset "
            "root's.",
        ),
    ] = None,
    mesh_scale: MeshUnit = None,
    objects_per_scene: Annotated[
        str | None,
        typer.Option(metavar="MIN-MAX", show_default="4-9", help="Objects dropped into a scene."),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WxH", show_default="1280x720", help="Size of the images in pixels."),
    ] = None,
    sdf: Annotated[
        bool,
        typer.Option("--sdf", help="Write textured.sdf too, as dex-net does: 10 MB per object."),
    ] = False,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Make a dataset in GraspNet-1Billion's layout, of procedural objects or your meshes."""
    from pipelines import synthesize as stage

    if objects_per_scene is not None:
        fewest, most = parse_pair(objects_per_scene, "-", "--objects-per-scene")
        config = replace(config, min_objects=fewest, max_objects=most)
    if size is not None:
        width, height = parse_pair(size, "x", "--size")
        config = replace(config, width=width, height=height)
    report = stage.run(
        output, config, options, seed=seed, models=models, mesh_scale=mesh_scale, sdf=sdf
    )
    conclude(report, output, then=("annotate-symmetry", output))


def parse_pair(text: str, separator: str, option: str) -> tuple[int, int]:
    """Return the two positive numbers of `text`, the first not above the second for a range."""
    parts = text.split(separator)
    if len(parts) != 2 or not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise typer.BadParameter(f"{option} is {text}; two numbers with {separator} are expected")
    first, second = int(parts[0]), int(parts[1])
    if separator == "-" and first > second:
        raise typer.BadParameter(f"{option} is {text}; the first number must not be the larger")
    return first, second
