"""Settings of one frame's grasp planning: sensor, selection, limits."""

from dataclasses import dataclass, field
from math import inf, pi
from typing import Literal

from pipelines.configs.declaration import BY_EYE, choice, count, fraction, setting

RankingMethod = Literal["critic", "eq8"]
ReferenceFrame = Literal["camera", "table"]
SymmetrySource = Literal["network", "network+shape", "shape"]

ROBOT = "user's robot"


@dataclass(frozen=True)
class SensorConfig:
    """Depth errors that are allowed when counterparts are checked against the depth image."""

    behind_tolerance: float = setting(
        0.005, "m", "Largest distance of a counterpart in front of the seen surface.", "D. 6"
    )
    depth_noise: float = setting(
        0.003, "m", "Depth noise at one metre; grows with the square of depth.", "D. 6"
    )


@dataclass(frozen=True)
class SymmetryConfig:
    """Belief in the predicted symmetries of a region."""

    is_fitted: bool = choice(
        True, "Fit predicted symmetries to the seen surface; the paper does not.", "D. 31"
    )
    candidates: SymmetrySource = choice(
        "network+shape",
        "Source of the symmetries that are fitted: the network, the region's shape, or both.",
        "D. 65, D. 140",
    )
    min_existence: float = fraction(
        0.5, "Least existence of a symmetry that is not fitted.", "D. 4"
    )
    min_confidence: float = fraction(
        0.2, "Least confidence of a fitted symmetry for grasps across it.", "D. 66, D. 85"
    )
    min_completion_confidence: float = fraction(
        0.5, "Least confidence of a symmetry that completes the unseen side.", "D. 32"
    )
    min_neighbor_confidence: float = fraction(
        0.3, "Least confidence for neighbours, whose completion is an obstacle.", "D. 85"
    )

    @property
    def least_confidence(self) -> float:
        """Confidence of a symmetry above which grasps across it come before all others."""
        return self.min_confidence if self.is_fitted else self.min_existence


@dataclass(frozen=True)
class CandidateConfig:
    """Contact pairs of a region and the approaches to try at each (Sec. III-E, III-F)."""

    min_affordance: float = fraction(
        0.5, "Least affordance of the first contact of a grasp.", "Sec. III-E"
    )
    max_pairs: int = count(256, "Most contact pairs tried in a region.", "D. 85")
    pair_spacing: float = setting(
        0.006,
        "m",
        "Edge of the cubes, each with the first contact of one tried pair.",
        "D. 85",
        low=1e-4,
    )
    num_approach_angles: int = count(
        12, "Approach directions tried about a contact line, M of Sec. III-F.", BY_EYE
    )


@dataclass(frozen=True)
class FeasibilityConfig:
    """Checks that a grasp must pass at its region (Sec. III-F)."""

    min_width: float = setting(0.003, "m", "Distance below which two contacts are one.", BY_EYE)
    min_enclosed: float = setting(
        0.004, "m", "Least height of the object between the fingers.", BY_EYE
    )
    min_table_distance: float = setting(
        0.004, "m", "Least height of the gripper over the table, on its approach too.", BY_EYE
    )
    keeps_off_plane: bool = choice(
        True,
        "Keep the gripper above the support plane, also where it is unseen; without this, "
        "approaches are limited as if there were no plane, by `max_view_angle`.",
        BY_EYE,
    )
    keeps_within_image: bool = choice(
        True,
        "Keep the gripper out of the space beyond an image border that cuts the region.",
        "D. 109",
    )
    max_approach_angle: float = setting(
        1.75, "rad", "Largest angle between approach and the table's inward normal.", BY_EYE
    )
    max_view_angle: float = setting(
        1.05, "rad", "Largest angle between approach and view ray where no table is seen.", BY_EYE
    )
    max_hidden_angle: float = setting(
        1.92, "rad", "Same angle over a table: no approach from behind the seen surface.", BY_EYE
    )
    scene_resolution: float = setting(
        0.003, "m", "Point spacing of the scene in collision checks.", BY_EYE, low=1e-4
    )
    body_margin: float = setting(
        0.001, "m", "Distance by which the gripper's bodies are enlarged.", BY_EYE
    )
    max_points_inside: int = count(
        2, "Most measured points inside a body, as noise.", BY_EYE, low=0
    )
    approach_distance: float = setting(
        0.10, "m", "Length of the approach path that must be free.", "D. 77"
    )
    opening_margins: tuple[float, ...] = setting(
        (0.008, 0.004), "m", "Opening margins to try, the largest first.", "D. 92", fewest=0
    )
    opening_margin_share: float = fraction(
        0.25, "Largest opening margin, as a share of the width.", "D. 102"
    )
    encloses_seen_points: bool = choice(
        True,
        "Move contacts of grasps without symmetry apart to enclose the points between the fingers.",
        "D. 153",
    )


@dataclass(frozen=True)
class RankingConfig:
    """Order of feasible grasps, and conditions to try other kinds of grasps (Sec. III-F)."""

    by: RankingMethod = choice(
        "critic", "Order of grasps: critic, by expected quality; eq8, as in the paper.", "D. 82"
    )
    clearance_cap: float = setting(
        0.05, "m", "Largest clearance b that counts in Eq. 8.", "D. 7", low=1e-4
    )
    enclosed_height_cap: float = setting(
        0.03, "m", "Largest enclosed height h that counts in Eq. 8.", "D. 7", low=1e-4
    )
    weight_clearance: float = setting(1.0, "weight", "w^b of Eq. 8.", "Sec. III-G")
    weight_height: float = setting(5.0, "weight", "w^h of Eq. 8.", "Sec. III-G")
    weight_unseen: float = fraction(
        0.9, "Share of Eq. 8 lost if the space around the finger tips is unseen.", "D. 68"
    )
    max_ranked: int = count(
        192, "Most grasps ranked in a region and pass, the most stable first.", "D. 150"
    )
    min_stability: float = fraction(
        0.85, "Least stability for Eq. 8, relative to the most stable free grasp.", "D. 28"
    )
    critic_min_stability: float = fraction(
        0.6, "Least stability for the critic, relative to the most stable free grasp.", "D. 82"
    )
    half_torque_arm: float = setting(
        0.09, "m", "Lever arm of the weight that halves a score.", "D. 143", low=1e-3
    )
    nms_distance: float = setting(
        0.03, "m", "Distance below which grasps of a region are alike, as in GraspNet.", "D. 78"
    )
    nms_angle: float = setting(
        pi / 6, "rad", "Angle below which grasps of a region are alike, as in GraspNet.", "D. 78"
    )
    sufficient: float = fraction(
        0.6, "Expected quality from which no better kind of grasp is sought.", "D. 82"
    )
    alternatives: int = count(
        10,
        "Grasps of a region below which other kinds of grasps are added, ranked after the best.",
        "D. 146",
        low=0,
    )

    @property
    def uses_critic(self) -> bool:
        """Whether grasps are ranked by the quality that the grasp critic expects."""
        return self.by == "critic"


@dataclass(frozen=True)
class SelectionConfig:
    """Physics-feasible grasp selection (Sec. III-F)."""

    symmetry: SymmetryConfig = field(default_factory=SymmetryConfig)
    candidates: CandidateConfig = field(default_factory=CandidateConfig)
    feasibility: FeasibilityConfig = field(default_factory=FeasibilityConfig)
    ranking: RankingConfig = field(default_factory=RankingConfig)


@dataclass(frozen=True)
class LimitsConfig:
    """Limits of a robot: workspace and approach directions; by default none."""

    box: tuple[float, ...] = setting(
        (),
        "m",
        "Corners x0,y0,z0,x1,y1,z1 of the workspace; empty for none.",
        ROBOT,
        low=-inf,
        fewest=0,
    )
    box_frame: ReferenceFrame = choice(
        "camera",
        "Frame of the box: camera; or table: z up from the table, origin at its point nearest to "
        "the camera.",
        ROBOT,
    )
    approach_cone: float = setting(
        180.0, "deg", "Largest angle between approach axis and approach direction.", ROBOT
    )
    approach_direction: tuple[float, float, float] = setting(
        (0.0, 0.0, -1.0),
        "direction",
        "Approach direction x,y,z, the cone's axis, towards the object.",
        ROBOT,
        low=-inf,
    )
    approach_frame: ReferenceFrame = choice("table", "Frame of the approach direction.", ROBOT)
