"""Units that a bootstrap draws: frames, or scenes with all their views."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.configs.evaluation import BootstrapUnit
from pipelines.dataset.graspnet.graspnet_layout import frame_key
from pipelines.metrics.paired_bootstrap import FEWEST_UNITS

VIEWS_NOTE = (
    "Views of one scene are alike: intervals over frames are too narrow, --unit scene is better."
)
UNIT_ENTRY = "interval_unit"  # of a report; reports made before drew frames


def bootstrap_units(names: Sequence[str], unit: BootstrapUnit) -> NDArray[np.int64]:
    """Return (f,) the index of the unit of each frame: its scene, or the frame itself.

    A frame whose name has no scene of GraspNet's layout is its own unit.
    """
    if unit == "frame":
        return np.arange(len(names))
    scenes = [str(key[0]) if (key := frame_key(name)) else name for name in names]
    return np.unique(scenes, return_inverse=True)[1].astype(np.int64)


def interval_note(report: Mapping[str, Any]) -> str:
    """Return the sentences on the intervals in the tables of a `report.json`."""
    unit = report.get(UNIT_ENTRY, "frame")
    note = f"In brackets: 95 % interval, a bootstrap over {unit}s; none over fewer than "
    return f"{note}{FEWEST_UNITS} {unit}s.{f' {VIEWS_NOTE}' if unit == 'frame' else ''}"
