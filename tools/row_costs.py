"""Costs of the rows of `make tables`: `python -m tools.row_costs FOLDER` writes FOLDER/costs.json.

A table for `symgrasp evaluate --table`. The grasps file of each row gives seconds per frame and
networks; the weights of FOLDER/weights and their checkpoints give steps and hours.
"""

import argparse
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pipelines.errors import MissingInputError, errors_as_sentences
from pipelines.evaluation.reports.reports import GivenTable
from pipelines.evaluation.rows import ordered_rows, report_row
from pipelines.grasp_files.grasps_stream import read_index
from pipelines.learning.loop.runs import CHECKPOINT, Progress, file_of_run
from pipelines.storage.checkpoints import load_arrays, load_training
from pipelines.storage.files import write_json
from pipelines.storage.h5_files import open_h5
from pipelines.storage.provenance import digest

SHIPPED = Path(__file__).parents[1] / "pipelines" / "weights"
# Tensors saved with a network, but not learned by gradient descent.
BUFFERS = ("running_mean", "running_var", "num_batches_tracked", "mean", "spread", "unit")
HEADER = [
    "row",
    "seconds a frame",
    "parameters",
    "with detector and critics",
    "steps",
    "hours of training",
]
NOTE = (
    "Seconds: the median of `infer` in its run, slower with other work on the machine. "
    "Parameters, steps and hours: of the row's own network; steps and hours if its weights or its "
    "checkpoint contain them."
)


def parameters(path: Path) -> int:
    """Return the number of learned parameters of a weights file."""
    tensors, _ = load_arrays(path)
    return sum(each.size for name, each in tensors.items() if name.split(".")[-1] not in BUFFERS)


def training(path: Path) -> tuple[str, str]:
    """Return the steps and hours of the training that wrote the weights `path`, - if unknown."""
    checkpoint = file_of_run(path, CHECKPOINT)
    if checkpoint.exists():
        progress = Progress.of(load_training(checkpoint).progress, checkpoint)
        return f"{progress.total_steps:,}", f"{progress.seconds / 3600:.1f}"
    _, metadata = load_arrays(path)
    return f"{int(metadata['steps']):,}" if "steps" in metadata else "-", "-"


def seconds_per_frame(grasps: Path) -> float:
    """Return the median time of a frame, nan if no time was written."""
    with open_h5(grasps) as file:
        seconds = file["frames/seconds"][()]
    known = seconds[np.isfinite(seconds)]
    return float(np.median(known)) if len(known) else float("nan")


def costs(rows: Iterable[Path], weights: Path) -> GivenTable:
    """Return the table of the grasps `rows`, with their own weights in the folder `weights`."""
    files = {digest(path): path for path in sorted(SHIPPED.glob("*.safetensors"))}
    own = [path for path in weights.glob("*.safetensors") if ".checkpoint" not in path.name]
    files |= {digest(path): path for path in own}
    by_name = {path.stem: path for path in rows}
    body = []
    for name in ordered_rows(by_name):
        named = read_index(by_name[name]).attrs["weights"]
        network = named.get("peer", named.get("network"))
        seconds = seconds_per_frame(by_name[name])
        cells = ["-" if np.isnan(seconds) else f"{seconds:.2f}"]
        for digests in ([network] if network else [], named.values()):
            used = [files.get(each) for each in digests]
            known = [path for path in used if path is not None]
            count = f"{sum(map(parameters, known)):,}" if len(known) == len(used) else "-"
            cells.append(count if used else "none")
        trained = files.get(network)
        effort = training(trained) if trained in own else ("-", "-")
        body.append([report_row(name).title, *cells, *effort])
    return GivenTable("Cost of each row", HEADER, body, NOTE)


@errors_as_sentences()
def main() -> None:
    """Write the table of a folder of `make tables`.

    Raises:
        MissingInputError: the folder has no rows.
    """
    parser = argparse.ArgumentParser(prog="python -m tools.row_costs")
    parser.add_argument("folder", type=Path, help="with rows/NAME.h5 and weights/NAME.safetensors")
    folder = parser.parse_args().folder
    rows = sorted((folder / "rows").glob("*.h5"))
    if not rows:
        raise MissingInputError(folder / "rows" / "*.h5", "make tables")
    table = costs(rows, folder / "weights")
    write_json(folder / "costs.json", asdict(table))


if __name__ == "__main__":
    main()
