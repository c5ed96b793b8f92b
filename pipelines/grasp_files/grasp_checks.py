"""Checks of grasps that were read from a `grasps.h5`, which other programs may have changed."""

import numpy as np

from pipelines.errors import SymgraspError
from pipelines.geometry.symmetry import NUM_SLOTS
from pipelines.geometry.transforms import nearest_orthogonal
from pipelines.grasp_files.grasps_tables import GraspTable

LARGEST_SKEW = 1e-3  # error of a rotation's entries, as in half precision; beyond is no rotation


def refuse_wrong_grasps(table: GraspTable) -> None:
    """Check that every row of `table` is a grasp.

    Raises:
        SymgraspError: a number is not finite, a rotation is none, a width is negative, or the slot
            of a symmetry does not exist.
    """
    for name in ("rotation", "translation", "width", "contacts", "rank_score"):
        if not np.isfinite(getattr(table, name)).all():
            raise SymgraspError(f"the {name} of a grasp is not finite; run infer again")
    rotation, slot = table.rotation.astype(np.float64), table.symmetry_slot
    skew = np.abs(nearest_orthogonal(rotation) - rotation).max(initial=0.0)
    if skew > LARGEST_SKEW or (np.linalg.det(rotation) < 0.0).any():
        raise SymgraspError("the rotation of a grasp is no rotation; run infer again")
    if (table.width < 0.0).any():
        raise SymgraspError("the width of a grasp is negative; run infer again")
    if ((slot < -1) | (slot >= NUM_SLOTS)).any():
        raise SymgraspError(
            f"the symmetry_slot of a grasp is none of -1 to {NUM_SLOTS - 1}; run infer again"
        )
