"""Trials of frames: the kind of symmetry that a trial counts for."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.geometry.region_masks import RegionInstance
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.simulation.frames import kind_at

COLUMN = np.arange(10)[None]
PLANE = ReflectionSymmetry([1, 0, 0], [0, 0, 0.5])
AXIS = RotationSymmetry([0, 0, 1], [0, 0, 0.5])
# Object 3 shows a region with a plane in six columns, then a region with an axis in three.
TRUTH = SimpleNamespace(
    instances=[
        RegionInstance(3, "body", COLUMN < 6, 1.0, (PLANE,)),
        RegionInstance(3, "knob", (COLUMN >= 6) & (COLUMN < 9), 1.0, (AXIS,)),
    ]
)


@pytest.mark.parametrize(
    ("object_id", "mask", "kind"),
    [
        (3, (COLUMN >= 5) & (COLUMN < 9), "rotation"),  # three of its pixels, one of the body
        (3, COLUMN < 8, "reflection"),
        (3, COLUMN == 9, "reflection"),  # in no region: the larger one counts
        (3, None, "reflection"),
        (4, COLUMN < 9, "none"),
    ],
)
def test_a_trial_counts_for_the_region_that_holds_most_of_its_mask(object_id, mask, kind):
    assert kind_at(TRUTH, object_id, mask) == kind
