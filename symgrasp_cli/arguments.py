"""Arguments of commands that are built from several options, shared by several commands."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.models import ParameterInfo

from symgrasp_cli.options import (
    AxisCriticWeights,
    Backend,
    DepthUnitsPerMetre,
    DetectorWeights,
    Device,
    DryRun,
    IntrinsicsText,
    Loaders,
    MaxMinutes,
    MaxSeconds,
    NetworkWeights,
    Overwrite,
    PlaneCriticWeights,
    Resume,
    Seed,
    Threads,
    Workers,
)
from symgrasp_cli.report import report_style

if TYPE_CHECKING:
    from pipelines.frames.frame_options import FrameOptions
    from pipelines.learning.loop.runs import RunRequest
    from pipelines.runtime.batch import BatchOptions

DEFAULT_THREADS = 2  # of a training, also on a machine with one core
WORKER_MEMORY = 1e9  # bytes; workers were seen to take half of it (docs/experiments/speed.md)


@dataclass(frozen=True)
class FromOptions:
    """Builds one argument of a command from several options: the parameters of `make`.

    A parameter of `make` may be such an argument itself; options with equal names are one option.
    """

    make: Callable[..., Any]

    @property
    def parameters(self) -> Iterable[inspect.Parameter]:
        """The parameters of `make`."""
        return inspect.signature(self.make).parameters.values()

    @staticmethod
    def of(parameter: inspect.Parameter) -> "FromOptions | None":
        """Return the `FromOptions` of the argument; None if the argument is one option."""
        metadata = getattr(parameter.annotation, "__metadata__", ())
        return next((each for each in metadata if isinstance(each, FromOptions)), None)


def options_of(parameters: Iterable[inspect.Parameter]) -> dict[str, inspect.Parameter]:
    """Return the options, by name, of a command with these parameters."""
    found: dict[str, inspect.Parameter] = {}
    for each in parameters:
        made = FromOptions.of(each)
        found |= options_of(made.parameters) if made else {each.name: each}
    return found


def arguments_of(
    parameters: Iterable[inspect.Parameter], values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a command with these parameters, from the `values` of its options.

    A link in place of an output is replaced by the file that it leads to.
    """
    return {each.name: _argument(each, values) for each in parameters}


def _argument(parameter: inspect.Parameter, values: Mapping[str, Any]) -> Any:  # noqa: ANN401
    if made := FromOptions.of(parameter):
        return made.make(**arguments_of(made.parameters, values))
    value = values[parameter.name]
    if isinstance(value, Path) and is_output(parameter):
        from pipelines.storage.files import file_behind

        return file_behind(value)
    return value


def is_output(parameter: inspect.Parameter) -> bool:
    """Return whether a path is written: inputs must exist."""
    metadata = getattr(parameter.annotation, "__metadata__", ())
    return not any(isinstance(each, ParameterInfo) and each.exists for each in metadata)


def preparation(
    workers: Workers = None, backend: Backend = "loky", overwrite: Overwrite = False
) -> "BatchOptions":
    """Return the options of a batch, which shows its progress unless the user wants quiet.

    By default there are as many workers as cores and free memory allow. More workers than cores
    only compete for memory, so a larger number is reduced to that of the cores.

    Raises:
        UnknownNameError: the backend is unknown.
    """
    import logging

    from joblib import cpu_count

    from pipelines.health.machine import free_memory
    from pipelines.runtime.batch import BatchOptions
    from pipelines.runtime.clusters import check_backend

    check_backend(backend)
    cores = cpu_count()
    if workers is None:
        free = free_memory()
        workers = cores if free is None else min(cores, max(1, int(free / WORKER_MEMORY)))
    elif backend == "loky" and workers > cores:
        warning = "--workers %d is more than this machine's %d cores: %d work at a time"
        logging.getLogger(__name__).warning(warning, workers, cores, cores)
        workers = cores
    return BatchOptions(
        workers=workers, backend=backend, overwrite=overwrite, progress=not report_style().quiet
    )


Preparation = Annotated["BatchOptions", FromOptions(preparation)]


def batch_options(options: Preparation, dry_run: DryRun = False) -> "BatchOptions":
    """Return the options of a batch that may be a dry run."""
    return replace(options, dry_run=dry_run)


Batch = Annotated["BatchOptions", FromOptions(batch_options)]


def run_on_cpu(
    max_seconds: MaxSeconds = None,
    max_minutes: MaxMinutes = None,
    threads: Threads = DEFAULT_THREADS,
    seed: Seed = 0,
    resume: Resume = False,
    overwrite: Overwrite = False,
) -> "RunRequest":
    """Return the request of a training, with a bar on a terminal and log lines elsewhere."""
    import logging
    import sys

    from joblib import cpu_count

    from pipelines.learning.loop.runs import RunRequest

    cores = cpu_count()
    if threads > max(cores, DEFAULT_THREADS):
        warning = "--threads %d is more than this machine's %d cores: %d work at a time"
        logging.getLogger(__name__).warning(warning, threads, cores, cores)
        threads = cores
    if max_seconds is not None and max_minutes is not None:
        raise typer.BadParameter("--time-limit is the old name of --max-seconds; give one of them")
    level = logging.WARNING if report_style().quiet else logging.INFO
    logging.getLogger("pipelines.learning").setLevel(level)
    bar = sys.stderr.isatty() and not report_style().quiet
    limit = max_seconds if max_minutes is None else 60.0 * max_minutes
    return RunRequest(seed, "cpu", threads, limit, resume, overwrite, bar)


CpuRun = Annotated["RunRequest", FromOptions(run_on_cpu)]


def run_on_device(request: CpuRun, device: Device = "auto") -> "RunRequest":
    """Return the request of a training that may run on a GPU."""
    return replace(request, device=device)


DeviceRun = Annotated["RunRequest", FromOptions(run_on_device)]


def run_with_loaders(request: DeviceRun, loaders: Loaders = 0) -> "RunRequest":
    """Return the request of a training that reads its batches from files."""
    return replace(request, loaders=loaders)


LoadedRun = Annotated["RunRequest", FromOptions(run_with_loaders)]


def frame_options(
    intrinsics: IntrinsicsText = None, depth_units_per_metre: DepthUnitsPerMetre = None
) -> "FrameOptions":
    """Return camera and depth units that the user gives for all frames, in place of files."""
    from pipelines.frames.cameras.camera_files import parse_camera
    from pipelines.frames.frame_options import FrameOptions

    camera = None if intrinsics is None else parse_camera(intrinsics)
    return FrameOptions(camera, depth_units_per_metre)


CameraAndUnits = Annotated["FrameOptions", FromOptions(frame_options)]


def models_for_symmetries(
    detector: DetectorWeights = None,
    network: NetworkWeights = None,
    axis_critic: AxisCriticWeights = None,
    plane_critic: PlaneCriticWeights = None,
) -> dict[str, Path | None]:
    """Return the weights that the user names, by model; None for the shipped weights."""
    return dict(
        detector=detector, network=network, axis_critic=axis_critic, plane_critic=plane_critic
    )


SymmetryModels = Annotated[dict[str, Path | None], FromOptions(models_for_symmetries)]
