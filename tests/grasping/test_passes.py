"""The obstacles of each pass in each attempt, as the table of `passes.py` lists them."""

import numpy as np
import pytest

from pipelines.configs import FeasibilityConfig
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.passes import attempts, planar_pass, random_pass, symmetric_pass
from pipelines.grasping.symmetries.completion import Completion
from tests.geometry.tabletops import Box
from tests.grasping.seen_regions import seen

GRIPPER, CAP = load_gripper("rg2"), 0.05  # metres
OWN, OTHERS = 0.001, -0.001  # metres from the region's middle
PASSES = {
    "symmetric": symmetric_pass(0.5),
    "planar": planar_pass(),
    "random": random_pass(np.random.default_rng(0)),
}


@pytest.fixture(scope="module")
def measured():
    _, scene, region = seen([Box((0.06, 0.09, 0.1))])
    return Feasibility.at(region, scene, GRIPPER, FeasibilityConfig(), CAP)


def unseen_points(measured, *, others=True):
    """A completion of a point of the region and a point of another region."""
    own, other = (measured.around.center + offset for offset in (OWN, OTHERS))
    return Completion(own[None], other[None] if others else np.zeros((0, 3)))


def unseen_obstacles(checks, measured):
    """The sides of which the unseen point is an obstacle."""
    added = checks.around.all.points[len(measured.around.all.points) :]
    sides = {"own": OWN, "others": OTHERS}
    center = measured.around.center
    return {
        name for name, at in sides.items() for point in added if np.allclose(point, center + at)
    }


@pytest.mark.parametrize(
    ("kind", "first", "second"),
    [
        ("symmetric", {"own", "others"}, {"own"}),
        ("planar", {"others"}, set()),
        ("random", {"others"}, set()),
    ],
)
def test_each_pass_keeps_off_the_unseen_sides_of_the_table(measured, kind, first, second):
    found = [
        unseen_obstacles(attempt.checks_of(PASSES[kind]), measured)
        for attempt in attempts(measured, unseen_points(measured))
    ]
    assert found == [first, second]


def test_every_attempt_keeps_off_all_measured_points(measured):
    count = len(measured.around.all.points)
    for attempt in attempts(measured, unseen_points(measured)):
        for each in PASSES.values():
            points = attempt.checks_of(each).around.all.points[:count]
            np.testing.assert_array_equal(points, measured.around.all.points)


def test_unseen_sides_do_not_change_the_clearance_of_eq_8(measured):
    for attempt in attempts(measured, unseen_points(measured)):
        for each in PASSES.values():
            assert attempt.checks_of(each).around.others is measured.around.others


def test_without_unseen_sides_of_others_there_is_one_attempt(measured):
    (attempt,) = attempts(measured, unseen_points(measured, others=False))
    assert unseen_obstacles(attempt.checks_of(PASSES["symmetric"]), measured) == {"own"}
