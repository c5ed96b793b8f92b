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
    """Errors of the depth camera, where a point known by symmetry is checked against the image."""

    behind_tolerance: float = setting(
        0.005, "m", "Distance that a counterpart may float before the seen surface.", "D. 6"
    )
    depth_noise: float = setting(
        0.003, "m", "Noise of depth at one metre; it grows with the square of depth.", "D. 6"
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
        0.2, "Least confidence of a fitted symmetry that grasps rest on.", "D. 66, D. 85"
    )
    min_completion_confidence: float = fraction(
        0.5, "Least confidence of a symmetry that completes the unseen side.", "D. 32"
    )
    min_neighbour_confidence: float = fraction(
        0.3, "The same of a neighbour's, whose completed side is an obstacle.", "D. 85"
    )

    @property
    def least_confidence(self) -> float:
        """Confidence above which a symmetry is grasped across before all other grasps."""
        return self.min_confidence if self.is_fitted else self.min_existence


@dataclass(frozen=True)
class CandidateConfig:
    """Contact pairs of a region and the approaches to try at each (Sec. III-E, III-F)."""

    min_affordance: float = fraction(
        0.5, "Least affordance of a point that a grasp is planned from.", "Sec. III-F"
    )
    max_pairs: int = count(256, "Contact pairs tried in a region.", "D. 85")
    pair_spacing: float = setting(
        0.006, "m", "Least distance between the first contacts of pairs that are tried.", "D. 85"
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
        0.004, "m", "Least distance between finger tips and table.", BY_EYE
    )
    keeps_off_plane: bool = choice(
        True, "Keep the gripper above the support plane, where it is seen and where not.", BY_EYE
    )
    keeps_within_image: bool = choice(
        True, "Keep off the space beyond the image where its border cuts the region off.", "D. 109"
    )
    max_approach_angle: float = setting(
        1.75, "rad", "Largest angle between approach and the table's inward normal.", BY_EYE
    )
    max_view_angle: float = setting(
        1.05, "rad", "Largest angle between approach and view ray where no table is seen.", BY_EYE
    )
    max_hidden_angle: float = setting(
        1.92, "rad", "The same over a table: no approach from behind what is seen.", BY_EYE
    )
    scene_resolution: float = setting(
        0.003, "m", "Spacing that the scene is thinned to for collisions.", BY_EYE, low=1e-4
    )
    body_margin: float = setting(
        0.001, "m", "Distance that the gripper's bodies are enlarged by.", "D. 101"
    )
    max_points_inside: int = count(
        2, "Measured points that a body may hold, as noise.", "D. 87", low=0
    )
    approach_distance: float = setting(
        0.10, "m", "Length of the approach path that must be free.", "D. 77"
    )
    opening_margins: tuple[float, ...] = setting(
        (0.008, 0.004), "m", "Opening margins to try, the largest first.", "D. 92"
    )
    opening_margin_share: float = fraction(0.25, "Largest opening margin, of the width.", "D. 102")


@dataclass(frozen=True)
class RankingConfig:
    """Order of feasible grasps, and when other kinds of grasps are tried (Sec. III-F)."""

    by: RankingMethod = choice(
        "critic", "Order of grasps: critic, by expected quality; eq8, as the paper.", "D. 82"
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
        0.9, "Share of Eq. 8 lost where the finger tips' space is all unseen.", "D. 68"
    )
    max_ranked: int = count(
        96, "Grasps of a region and pass that are ranked, the most stable.", "D. 82"
    )
    min_stability: float = fraction(
        0.85, "Least stability for Eq. 8, of the best candidate's.", "D. 28"
    )
    critic_min_stability: float = fraction(
        0.6, "Least stability for the grasp critic, of the best candidate's.", "D. 82"
    )
    half_torque_arm: float = setting(
        0.09, "m", "Lever of the weight that halves a score.", "D. 143", low=1e-3
    )
    nms_distance: float = setting(
        0.03, "m", "Distance below which grasps of a region are alike, as GraspNet's.", "D. 78"
    )
    nms_angle: float = setting(
        pi / 6, "rad", "Angle below which grasps of a region are alike, as GraspNet's.", "D. 78"
    )
    sufficient: float = fraction(
        0.6, "Expected quality from which no other kind of grasps is tried.", "D. 82"
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
    """Limits of a robot: where it may grasp, and from which directions; by default all."""

    box: tuple[float, ...] = setting(
        (), "m", "Corners x0,y0,z0,x1,y1,z1 of the workspace; empty for none.", ROBOT, low=-inf
    )
    box_frame: ReferenceFrame = choice(
        "camera", "Frame of the box; table: z up from it, its origin nearest to the camera.", ROBOT
    )
    approach_cone: float = setting(
        180.0, "deg", "Largest angle between approach and approach direction.", ROBOT
    )
    approach_direction: tuple[float, float, float] = setting(
        (0.0, 0.0, -1.0),
        "direction",
        "Axis x,y,z of that cone, towards the object.",
        ROBOT,
        low=-inf,
    )
    approach_frame: ReferenceFrame = choice("table", "Frame of the approach direction.", ROBOT)
