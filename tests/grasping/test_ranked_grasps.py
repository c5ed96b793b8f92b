"""Tables of ranked grasps, whose columns have one row for each grasp."""

from dataclasses import fields

import numpy as np

from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps


def ranked(count):
    """Return `count` grasps, whose columns hold different numbers."""
    grasps = GraspPoses(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), np.ones(count))
    source = np.array(["planar"] * count, "U7")
    first, second, third, fourth = (np.arange(count) + 10.0 * k for k in range(4))
    return RankedGrasps(grasps, first, np.arange(count), source, second, third, fourth)


def test_no_grasps_have_no_row_in_any_column():
    assert all(
        len(getattr(RankedGrasps.empty(), field.name)) == 0 for field in fields(RankedGrasps)
    )


def test_grasps_taken_apart_and_joined_are_the_same_in_every_column():
    whole = ranked(5)
    joined = RankedGrasps.concatenate([whole[:2], RankedGrasps.empty(), whole[2:]])
    for field in fields(RankedGrasps)[1:]:
        np.testing.assert_array_equal(getattr(joined, field.name), getattr(whole, field.name))
    np.testing.assert_array_equal(joined.grasps.width, whole.grasps.width)
