"""`symgrasp synthesize`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import LabelConfig, SynthesizeConfig
from symgrasp_cli.options import Backend, DryRun, Overwrite, Seed, Workers, batch_options
from symgrasp_cli.report import conclude

DEFAULTS = SynthesizeConfig()


def synthesize(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the dataset.")],
    models: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            help="Your own meshes instead of procedural objects: a mesh, a folder, or a dataset "
            "root's.",
        ),
    ] = None,
    mesh_scale: Annotated[
        float | None,
        typer.Option(min=1e-6, help="Metres per unit of the meshes: 0.001 for millimetres."),
    ] = None,
    splits: Annotated[
        str, typer.Option(help="Splits to make, of train, seen, similar, novel.")
    ] = ",".join(DEFAULTS.splits),
    scenes_per_split: Annotated[
        int, typer.Option(min=1, help="Scenes of each split.")
    ] = DEFAULTS.scenes_per_split,
    views: Annotated[
        int, typer.Option(min=1, help="Viewpoints a scene; GraspNet has 256.")
    ] = DEFAULTS.views,
    objects: Annotated[
        int, typer.Option(min=1, help="Objects of each pool: seen, similar, novel.")
    ] = DEFAULTS.objects_per_pool,
    objects_per_scene: Annotated[
        str, typer.Option(metavar="MIN-MAX", help="Objects dropped into a scene.")
    ] = f"{DEFAULTS.min_objects}-{DEFAULTS.max_objects}",
    sensor: Annotated[
        str, typer.Option(help="Depth sensor: perfect, kinect, realsense, or mixed (by scene).")
    ] = DEFAULTS.sensor,
    size: Annotated[
        str, typer.Option(metavar="WxH", help="Size of the images in pixels.")
    ] = f"{DEFAULTS.width}x{DEFAULTS.height}",
    grasp_points: Annotated[
        int, typer.Option(min=0, help="Labelled grasp points an object; 0 makes no labels.")
    ] = LabelConfig.num_points,
    collision_labels: Annotated[
        bool, typer.Option(help="Test the labels' grasps against each scene.")
    ] = DEFAULTS.collision_labels,
    sdf: Annotated[
        bool,
        typer.Option("--sdf", help="Write textured.sdf too, as dex-net does: 10 MB an object."),
    ] = False,
    seed: Seed = 0,
    workers: Workers = 1,
    backend: Backend = "loky",
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Make a dataset in GraspNet-1Billion's layout, of procedural objects or your meshes."""
    from pipelines import synthesize as stage

    width, height = parse_pair(size, "x", "--size")
    fewest, most = parse_pair(objects_per_scene, "-", "--objects-per-scene")
    config = SynthesizeConfig(
        splits=tuple(name.strip() for name in splits.split(",")),
        scenes_per_split=scenes_per_split,
        views=views,
        objects_per_pool=objects,
        min_objects=fewest,
        max_objects=most,
        sensor=sensor,
        width=width,
        height=height,
        collision_labels=collision_labels,
        labels=LabelConfig(num_points=grasp_points),
    )
    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    conclude(
        stage.run(output, config, options, seed=seed, models=models, mesh_scale=mesh_scale, sdf=sdf)
    )


def parse_pair(text: str, separator: str, option: str) -> tuple[int, int]:
    """Return the two positive numbers of `text`, the first not above the second for a range."""
    parts = text.split(separator)
    if len(parts) != 2 or not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise typer.BadParameter(f"{option} is {text}; two numbers with {separator} are expected")
    first, second = int(parts[0]), int(parts[1])
    if separator == "-" and first > second:
        raise typer.BadParameter(f"{option} is {text}; the first number must not be the larger")
    return first, second
