"""The passes over one region and the obstacles of each (Sec. III-F).

A pass proposes contact pairs. If the first attempt, over all passes, leaves no grasp, a second
attempt ignores the unseen sides of other regions (D. 85). A grasp must not meet these points:

    obstacles above the table                symmetric pass     planar or random pass
    measured points of and near the region   yes                yes
    every third pixel of the whole scene     on approach path   on approach path
    unseen side of the region (D. 32)        yes                no
    unseen sides of other regions (D. 85)    first attempt      first attempt

The scene clearance b of Eq. 8 is the distance to measured points of other regions in all cases.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import CandidateConfig
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping.candidates.candidates import (
    GraspCandidates,
    random_candidates,
    symmetric_candidates,
)
from pipelines.grasping.candidates.planar import planar_candidates
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.scene import RegionCloud
from pipelines.grasping.symmetries.completion import Completion

ALWAYS = np.inf


@dataclass(frozen=True)
class RegionModel:
    """The model of one region; without predictions, the measured points alone.

    Attributes:
        cloud: n points.
        symmetries: of the region.
        affordance: (n,) 0 to 1.
        completion: points that symmetries predict where the camera sees nothing.
    """

    cloud: RegionCloud
    symmetries: SymmetrySlots = field(default_factory=lambda: SymmetrySlots.of([]))
    affordance: Array = field(default_factory=lambda: np.zeros(0))
    completion: Completion = field(default_factory=Completion.none)


@dataclass(frozen=True)
class Pass:
    """One way to propose contact pairs.

    Attributes:
        candidates: the contact pairs of a region.
        unless_expected: if grasps with this score are found already, the pass adds alternatives
            only.
        keeps_off_own_side: whether the region's own unseen side is an obstacle.
    """

    candidates: Callable[[RegionModel, Feasibility, CandidateConfig], GraspCandidates]
    unless_expected: float = ALWAYS
    keeps_off_own_side: bool = False


def symmetric_pass(above: float, below: float = np.inf, unless_expected: float = ALWAYS) -> Pass:
    """Return the pass across symmetries of confidence between `above` and `below` (Sec. III-E)."""

    def pairs(
        region: RegionModel, feasibility: Feasibility, config: CandidateConfig
    ) -> GraspCandidates:
        symmetries = region.symmetries.between(above, below)
        return symmetric_candidates(
            region.cloud, symmetries, region.affordance, config, feasibility
        )

    return Pass(pairs, unless_expected, keeps_off_own_side=True)


def planar_pass(unless_expected: float = ALWAYS) -> Pass:
    """Return the pass of opposite points on the region's outline (D. 8)."""
    return Pass(lambda region, checks, _: planar_candidates(region.cloud, checks), unless_expected)


def random_pass(rng: np.random.Generator) -> Pass:
    """Return the pass of random antipodal pairs, a baseline."""
    return Pass(lambda region, checks, config: random_candidates(region.cloud, config, checks, rng))


@dataclass(frozen=True)
class Attempt:
    """The feasibility checks of one attempt over all passes.

    Attributes:
        without_own_side: checks that ignore the region's unseen side.
        with_own_side: checks with the region's unseen side as an obstacle.
    """

    without_own_side: Feasibility
    with_own_side: Feasibility

    def checks_of(self, step: Pass) -> Feasibility:
        """Return the checks of the grasps of a pass."""
        return self.with_own_side if step.keeps_off_own_side else self.without_own_side


def attempts(measured: Feasibility, completion: Completion) -> Iterator[Attempt]:
    """Yield the attempts at a region, the most careful first; see the module's table.

    `measured`: checks whose obstacles are the measured points.
    """
    if len(completion.others):
        careful = measured.with_unseen(completion.others)
        yield Attempt(careful, careful.with_unseen(completion.own))
    yield Attempt(measured, measured.with_unseen(completion.own))
