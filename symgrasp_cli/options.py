"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

LARGEST_SEED = 2**63 - 1


def _check_seed(seed: int) -> int:
    if not 0 <= seed <= LARGEST_SEED:
        raise typer.BadParameter(f"{seed} is not from 0 to {LARGEST_SEED}")
    return seed


RUNNING, READING, REPORT = "Running", "Reading frames", "Report"  # panels of help

Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        envvar="SYMGRASP_WORKERS",
        rich_help_panel=RUNNING,
        help="Processes that work at a time; by default as many as help.",
    ),
]
Backend = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        envvar="SYMGRASP_BACKEND",
        rich_help_panel=RUNNING,
        help="joblib's backend: loky, or dask or ray with that extra installed.",
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        metavar="N",
        rich_help_panel=RUNNING,
        callback=_check_seed,
        help="Seed of everything that is drawn at random.",
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option("--overwrite", rich_help_panel=RUNNING, help="Make outputs again that exist."),
]
DryRun = Annotated[
    bool,
    typer.Option("--dry-run", rich_help_panel=RUNNING, help="Say what would be done, do nothing."),
]
Device = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        envvar="SYMGRASP_DEVICE",
        rich_help_panel=RUNNING,
        help="auto, cpu, cuda or cuda:N; auto takes a GPU if there is one.",
    ),
]
Resume = Annotated[
    bool,
    typer.Option("--resume", rich_help_panel=RUNNING, help="Go on with an unfinished training."),
]
Threads = Annotated[
    int, typer.Option(min=1, metavar="N", rich_help_panel=RUNNING, help="CPU cores to train on.")
]
MaxSeconds = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="SECONDS",
        rich_help_panel=RUNNING,
        help="Time after which to stop cleanly; --resume goes on.",
    ),
]
MaxMinutes = Annotated[
    float | None,
    typer.Option("--time-limit", min=0.0, hidden=True, help="Old name of --max-seconds, minutes."),
]
Precision = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        rich_help_panel=RUNNING,
        help="Of the large products of a training step: float32, or bf16 for GPUs.",
    ),
]
Loaders = Annotated[
    int,
    typer.Option(
        metavar="N",
        min=0,
        rich_help_panel=RUNNING,
        help="Processes that load batches ahead, so that a GPU need not wait; 0: a thread.",
    ),
]
Compile = Annotated[
    bool,
    typer.Option(
        "--compile",
        rich_help_panel=RUNNING,
        help="Compile chains of layers, for GPUs; slow to start.",
    ),
]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json", rich_help_panel=REPORT, help="Print the report as one JSON object on stdout."
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", rich_help_panel=REPORT, help="Print errors only on stderr.")
]
DatasetSplit = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        callback=lambda split: None if split == "all" else split,
        help="Scenes to take: train, seen, similar, novel or all.",
    ),
]
CameraName = Annotated[
    str | None, typer.Option(metavar="NAME", help="kinect or realsense; every camera if not given.")
]
MeshUnit = Annotated[
    float | None,
    typer.Option(
        "--mesh-scale",
        min=1e-6,
        metavar="X",
        help="Metres by unit of the meshes' files; 0.001 for millimetres.",
    ),
]
DetectorWeights = Annotated[
    Path | None,
    typer.Option(exists=True, help="Weights of the region detector, if not the default."),
]
NetworkWeights = Annotated[
    Path | None, typer.Option(exists=True, help="Weights of the grasp network, if not the default.")
]
AxisCriticWeights = Annotated[
    Path | None, typer.Option(exists=True, help="Weights of the axis critic, if not the default.")
]
PlaneCriticWeights = Annotated[
    Path | None, typer.Option(exists=True, help="Weights of the plane critic, if not the default.")
]
GraspCriticWeights = Annotated[
    Path | None, typer.Option(exists=True, help="Weights of the grasp critic, if not the default.")
]
With = Annotated[
    list[Path] | None,
    typer.Option(
        "--with",
        exists=True,
        dir_okay=False,
        help="Another grasps.h5 of the same frames, a row called as the file; may be given again.",
    ),
]
DatasetRoot = Annotated[
    Path,
    typer.Option(
        exists=True,
        file_okay=False,
        metavar="FOLDER",
        help="Root of the dataset, GraspNet's layout.",
    ),
]
FrameFolder = Annotated[
    Path,
    typer.Argument(
        exists=True,
        help="Folder of RGB-D frames in any layout that the docs list, or one frame's file.",
    ),
]
IntrinsicsText = Annotated[
    str | None,
    typer.Option(
        metavar="TEXT",
        rich_help_panel=READING,
        help="fx,fy,cx,cy in pixels, or a camera file, for all frames.",
    ),
]
DepthUnitsPerMetre = Annotated[
    float | None,
    typer.Option(
        metavar="X",
        rich_help_panel=READING,
        help="Number that depth values are divided by to give metres.",
    ),
]


GraspsToRead = Annotated[
    Path, typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer`.")
]
CameraToBase = Annotated[
    Path | None,
    typer.Option(
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="Hand-eye calibration (4 x 4 matrix, easy_handeye, MoveIt): poses are then in "
        "the robot's base frame.",
    ),
]
WeightsToWrite = Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")]
StartWeights = Annotated[
    Path | None, typer.Option(exists=True, help="Weights of an earlier training to start from.")
]
