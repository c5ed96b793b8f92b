"""Files that hold nothing but the unit of the depth, next to the images, as scripts save them.

A RealSense D405 counts in 0.1 mm and an L515 in 0.25 mm; as millimetres both look plausible.
"""

import re
from pathlib import Path

import numpy as np

from pipelines.errors import FormatError
from pipelines.frames.depth.stated_units import units_in
from pipelines.storage.array_files import read_npy
from pipelines.storage.files import read_text

NAME = re.compile(r"(?:camera[-_.])?depth[-_.]?(?:scale|units?)\.(?:txt|npy)", re.IGNORECASE)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MAX_BYTES = 160  # a number in an .npy takes 136; longer arrays are depth of a frame named `scale`
LEAST_UNITS = 100.0  # per metre; a number that means fewer is a correction of the depth
EXPECTED = (
    "metres per unit, such as 0.001, or units per metre are expected; "
    "--depth-units-per-metre overrides it"
)


def scale_file(folder: Path) -> Path | None:
    """Return the file in `folder` that states the unit of the depth of all frames."""
    named = sorted(path for path in folder.iterdir() if NAME.fullmatch(path.name))
    files = (path for path in named if path.is_file() and path.stat().st_size <= MAX_BYTES)
    return next(files, None)


def read_scale(path: Path) -> float:
    """Return the units per metre that `path`, with one number or the name of a unit, states.

    Raises:
        FormatError: another content, or a number that is no unit.
    """
    stated: object
    if path.suffix.lower() == ".npy":
        numbers = np.atleast_1d(read_npy(path)).ravel()
        stated = numbers[0] if numbers.size == 1 else numbers
    else:
        text = read_text(path, MAX_BYTES).strip()
        numbers_in_text = NUMBER.findall(text)
        stated = numbers_in_text[0] if len(numbers_in_text) == 1 else text
    try:
        units = units_in({"depth_scale": stated})
    except (TypeError, ValueError):
        units = None
    # Written so that nan fails too. 1 comes from the name `m` alone: the number 1 is BOP's, 1000.
    if units is None or not (LEAST_UNITS <= units < np.inf or units == 1.0):
        raise FormatError(path, f"states the unit of the depth as {stated!s:.40}", EXPECTED)
    return units
