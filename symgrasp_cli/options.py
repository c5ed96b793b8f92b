"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Any

import typer

from pipelines.runtime.device_names import check_device_name

LARGEST_SEED = 2**63 - 1
RUNNING, READING, REPORT = "Running", "Reading frames", "Report"  # panels of help


def _check_seed(seed: int) -> int:
    if not 0 <= seed <= LARGEST_SEED:
        raise typer.BadParameter(f"{seed} is not from 0 to {LARGEST_SEED}")
    return seed


def _check_device(name: str) -> str:
    check_device_name(name, "--device")  # its GPU is looked for where a network runs
    return name


def _running(help_text: str, *names: str, **options: Any) -> Any:  # noqa: ANN401 - typer's own
    """Return an option in the help's panel on how a command runs."""
    return typer.Option(*names, rich_help_panel=RUNNING, help=help_text, **options)


def _weights(model: str) -> Any:  # noqa: ANN401 - typer's own
    """Return the option of a file of weights that the package ships too."""
    return typer.Option(exists=True, help=f"Weights of the {model}, if not the default.")


Workers = Annotated[
    int | None,
    _running(
        "Processes that work in parallel; by default as many as are useful.",
        min=1,
        metavar="N",
        envvar="SYMGRASP_WORKERS",
    ),
]
Backend = Annotated[
    str,
    _running(
        "joblib's backend: loky (processes), threading, or dask or ray with that extra installed.",
        metavar="NAME",
        envvar="SYMGRASP_BACKEND",
    ),
]
Seed = Annotated[
    int, _running("Seed of everything that is drawn at random.", metavar="N", callback=_check_seed)
]
Overwrite = Annotated[bool, _running("Replace existing outputs.", "--overwrite")]
DryRun = Annotated[bool, _running("Print the planned work, do nothing.", "--dry-run")]
Device = Annotated[
    str,
    _running(
        "auto, cpu, cuda or cuda:N; auto takes a GPU if there is one.",
        metavar="NAME",
        envvar="SYMGRASP_DEVICE",
        callback=_check_device,
    ),
]
Resume = Annotated[bool, _running("Continue an unfinished training.", "--resume")]
Threads = Annotated[int, _running("CPU cores to train on.", min=1, metavar="N")]
MaxSeconds = Annotated[
    float | None,
    _running(
        "Time of training, without its preparation, after which to stop cleanly, at least one step "
        "later; --resume continues.",
        min=0.0,
        metavar="SECONDS",
    ),
]
MaxMinutes = Annotated[
    float | None,
    typer.Option("--time-limit", min=0.0, hidden=True, help="Old name of --max-seconds, minutes."),
]
Loaders = Annotated[
    int,
    _running(
        "Processes that load batches ahead, so that a GPU need not wait; 0: a thread.",
        min=0,
        metavar="N",
    ),
]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json", rich_help_panel=REPORT, help="Print the report as one JSON object on stdout."
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", rich_help_panel=REPORT, help="Print only warnings and errors on stderr."
    ),
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
        max=1e3,
        metavar="X",
        help="Metres per unit of the mesh files; 0.001 for millimetres.",
    ),
]
DetectorWeights = Annotated[Path | None, _weights("region detector")]
NetworkWeights = Annotated[Path | None, _weights("grasp network")]
AxisCriticWeights = Annotated[Path | None, _weights("axis critic")]
PlaneCriticWeights = Annotated[Path | None, _weights("plane critic")]
GraspCriticWeights = Annotated[Path | None, _weights("grasp critic")]
With = Annotated[
    list[Path] | None,
    typer.Option(
        "--with",
        exists=True,
        dir_okay=False,
        help="Another grasps.h5 of the same frames, a row named as the file; may be given again.",
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
WeightsToWrite = Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")]
StartWeights = Annotated[
    Path | None, typer.Option(exists=True, help="Weights of an earlier training to start from.")
]
