"""The true owners of predicted regions."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.configs import EvaluateConfig
from pipelines.evaluation.frame_scores import RegionOwners, _scored_slots, assign_regions
from pipelines.geometry.region_masks import RegionInstance
from pipelines.geometry.symmetry import ReflectionSymmetry, SymmetrySlots
from pipelines.metrics.symmetry_matching import CORRECT, WRONG, TrueRegion

COLUMN = np.arange(20)[None]
# Objects 4 and 7 show one region each, in ten columns and in six; columns 16 to 19 are table.
LABEL = np.where(COLUMN < 10, 5, np.where(COLUMN < 16, 8, 0))
TRUTH = SimpleNamespace(
    label=LABEL, instances=[RegionInstance(i, "whole", i + 1 == LABEL, 1.0, ()) for i in (4, 7)]
)


@pytest.mark.parametrize(
    ("first", "last", "object_id", "instance"),
    [
        (0, 9, 4, 0),
        (5, 9, 4, 0),  # 5 of 10 columns
        (6, 9, 4, -1),  # 4 of 10: on the object, but no match for its region
        (10, 19, 7, 1),  # 6 of 10, and 4 on the table
        (14, 19, -1, -1),  # 2 of its 6 columns on an object, 2 of 10 of the union
    ],
)
def test_a_region_has_the_object_under_most_of_it_and_the_true_region_that_it_matches(
    first, last, object_id, instance
):
    config = EvaluateConfig(min_region_iou=0.5, min_region_share=0.5)
    mask = (first <= COLUMN) & (last >= COLUMN)
    owners = assign_regions([mask], TRUTH, config)
    assert (owners.object_id, owners.instance) == ([object_id], [instance])


def test_symmetries_of_any_confidence_are_ranked():
    plane, other = (ReflectionSymmetry(np.eye(3)[axis], np.zeros(3)) for axis in (0, 1))
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (50, 3))
    truth = SimpleNamespace(regions=[TrueRegion(points, (plane,))])
    slots = SymmetrySlots.of([(0, other, 0.7), (1, plane, 0.02)])
    config = EvaluateConfig(symmetry_thresholds=(0.25,))
    found = _scored_slots([slots], RegionOwners([0], [0]), truth, config)["reflection"]
    assert (found.num_truth, found.confidence) == (1, [0.7, 0.02])
    assert found.verdicts == {"0.25": [WRONG, CORRECT]}
